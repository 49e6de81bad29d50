"""One way to compile a numerical kernel, so that all of them share their flags and cache."""

from __future__ import annotations

from collections.abc import Callable
from typing import ParamSpec, TypeVar, cast

import numba

_P = ParamSpec('_P')
_R = TypeVar('_R')


def compiled(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile ``function`` with numba, cached on disk, keeping its type for the type checker.

    No fast-math: a replay must give the same bits as the run, whatever the vector length of the
    loop that was compiled.
    """
    return cast('Callable[_P, _R]', numba.njit(cache=True)(function))
