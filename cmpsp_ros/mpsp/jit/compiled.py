"""One way to compile a numerical kernel, so that all of them share their flags and cache."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, ParamSpec, TypeVar, cast

import numba
import numpy as np

from cmpsp_ros.mpsp.jit import internals
from cmpsp_ros.mpsp.jit.cache import KernelCache
from cmpsp_ros.mpsp.jit.folder import kernel_folder

ALLOCATION_FREE: Final = {'_nrt': False, 'error_model': 'numpy', 'no_cfunc_wrapper': True}
"""Options of numba for functions that allocate nothing.

Division by zero gives what IEEE 754 says: to look for it at every division takes a tenth of the
solver's time, and results are checked to be finite where it counts.
"""

_overloads: Final[dict[Any, Any]] = {}

_P = ParamSpec('_P')
_R = TypeVar('_R')


def compiled(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile ``function`` with numba, cached on disk, keeping its type for the type checker.

    No fast-math: a replay must give the same bits as the run, on processors with other vector
    lengths, too.
    """
    return _compile(function)


def allocation_free(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Like `compiled`, for functions that make no array: that one would is an error.

    Numba then counts no references either, which small functions on named tuples of arrays spend
    most of their time on.
    """
    return _compile(function, **ALLOCATION_FREE)


def inlined(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Like `allocation_free`, for functions that are always made part of their callers.

    A call passes all members of named tuples of arrays, which takes longer than a short function.
    """
    return _compile(function, forceinline=True, **ALLOCATION_FREE)


def inner(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Like `allocation_free`, for functions that only compiled code calls.

    No entry for Python is made, which would take a third of their compilation.
    """
    return _compile(function, no_cpython_wrapper=True, **ALLOCATION_FREE)


def entry_for(function: Callable[_P, _R], *arguments: Any) -> Callable[_P, _R]:
    """The machine code for arguments of these types, called without looking for it each time.

    Looking at the types of a few named tuples of arrays takes microseconds. It relies on
    `typeof_pyval`, `compile` and `overloads[...].entry_point` of numba's dispatchers. What was
    asked for once is found without them: a law makes hundreds of entries when it is configured.

    Args:
        function: A compiled function.
        arguments: Examples. All arguments of a call must have the very same types, arrays the
            same layout: nothing checks it.
    """
    return cast('Callable[_P, _R]', overload_for(function, arguments).entry_point)


def overload_for(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
    """What numba has compiled of a function for arguments of these types."""
    key = function, _kind(arguments)
    if key not in _overloads:
        dispatcher: Any = function
        types = tuple(dispatcher.typeof_pyval(argument) for argument in arguments)
        dispatcher.compile(types)
        _overloads[key] = dispatcher.overloads[types]
    return _overloads[key]


def _kind(value: Any) -> Any:
    """All that a type depends on: numba itself takes milliseconds to tell that of a few records."""
    if isinstance(value, np.ndarray):
        flags = value.flags
        layout = flags.c_contiguous, flags.f_contiguous, flags.writeable, flags.aligned
        return value.dtype, value.ndim, layout
    return (type(value), *map(_kind, value)) if isinstance(value, tuple) else type(value)


def _compile(function: Callable[_P, _R], **options: Any) -> Callable[_P, _R]:
    dispatcher = numba.njit(**options)(function)
    internals.set_cache(dispatcher, KernelCache(dispatcher, kernel_folder()))
    return cast('Callable[_P, _R]', dispatcher)
