"""Sizes that compiled code knows beforehand, or is told."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import types
from numba.extending import overload

from cmpsp_ros.mpsp.jit.compiled import ALLOCATION_FREE

Size = tuple[int, ...] | int
"""A size: a tuple of that many zeros where it is known when code is compiled, else the number.

The length of a tuple is part of its type, so that loops over it have a constant count. That makes
small systems several times faster, and every size is compiled for itself.
"""


def fixed(count: int) -> Size:
    """The size for code that is compiled for it alone."""
    return (0,) * count


def dimension(size: Size) -> int:
    """The number that a size stands for; for compiled code as well."""
    return len(size) if isinstance(size, tuple) else size


@overload(dimension, jit_options=ALLOCATION_FREE, strict=False)  # type: ignore[untyped-decorator]
def _dimension(size: Any) -> Callable[[Any], int]:
    if isinstance(size, types.BaseTuple):
        return lambda size: len(size)  # noqa: PLW0108 (numba compiles functions, not built-ins)
    return lambda size: size
