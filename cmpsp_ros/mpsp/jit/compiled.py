"""One way to compile a numerical kernel, so that all of them share their flags and cache."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any, Final, ParamSpec, TypeVar, cast

import numba
from numba.extending import overload

from cmpsp_ros.mpsp.jit import fingerprint, internals
from cmpsp_ros.mpsp.jit.cache import KernelCache
from cmpsp_ros.mpsp.jit.folder import kernel_folder

ALLOCATION_FREE: Final = {'_nrt': False, 'error_model': 'numpy'}
"""Options of numba for functions that allocate nothing.

Division by zero gives what IEEE 754 says: to look for it at every division takes a tenth of the
solver's time, and what is not finite is looked for anyway where it counts.
"""

_P = ParamSpec('_P')
_R = TypeVar('_R')


def compiled(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile ``function`` with numba, cached on disk, keeping its type for the type checker.

    No fast-math: a replay must give the same bits as the run, whatever the vector length of the
    loop that was compiled.
    """
    return _compile(function)


def allocation_free(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Like `compiled`, for functions that make no array: that one would is an error.

    Numba then counts no references either, which small functions on named tuples of arrays spend
    most of their time on.
    """
    return _compile(function, **ALLOCATION_FREE)


def inlined(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Like `allocation_free`, for a function that becomes a part of its callers.

    Handing over named tuples of a hundred arrays takes longer than many a function does its work.
    For small functions and for those with one caller: of any other there would be many copies.
    """
    return _compile(function, forceinline=True, **ALLOCATION_FREE)


def entry_for(function: Callable[_P, _R], *arguments: Any) -> Callable[_P, _R]:
    """The machine code for arguments of these types, called without looking for it each time.

    Looking at the types of a few named tuples of arrays takes microseconds. It relies on
    `typeof_pyval`, `compile` and `overloads[...].entry_point` of numba's dispatchers.

    Args:
        function: A compiled function.
        arguments: Examples. Whatever it is called with must have the very same types, arrays the
            same layout: nothing checks it.
    """
    dispatcher: Any = function
    types = tuple(dispatcher.typeof_pyval(argument) for argument in arguments)
    dispatcher.compile(types)
    return cast('Callable[_P, _R]', dispatcher.overloads[types].entry_point)


def implements(
    stub: Callable[..., Any], data_class: type[tuple[Any, ...]]
) -> Callable[[Callable[_P, _R]], Callable[_P, _R]]:
    """Make a function what ``stub`` does in compiled code for one class of data.

    A compiled loop that calls ``stub(data, ...)`` is compiled anew for every class of ``data``,
    with the implementation for that class inside: no call by pointer is left.

    Args:
        stub: Plain function that stands for all implementations; it is never run.
        data_class: Named tuple, the class of the first argument.

    Returns:
        Decorator; what it returns is compiled and can be called from Python as well.

    Raises:
        TypeError: From the decorator, if the parameters are not named as those of the stub.
    """

    def decorate(function: Callable[_P, _R]) -> Callable[_P, _R]:
        wanted, found = (list(inspect.signature(each).parameters) for each in (stub, function))
        if found != wanted:
            raise TypeError(
                f'{function.__qualname__} has the parameters ({", ".join(found)}), wanted'
                f' ({", ".join(wanted)}) as {stub.__qualname__}'
            )

        def choose(data: Any, *_rest: Any) -> Callable[_P, _R] | None:
            is_it = (
                isinstance(data, numba.types.BaseNamedTuple) and data.instance_class is data_class
            )
            return function if is_it else None

        overload(stub, jit_options=ALLOCATION_FREE, strict=False)(choose)
        fingerprint.implementations.setdefault(data_class, []).append(function)
        return allocation_free(function)

    return decorate


def _compile(function: Callable[_P, _R], **options: Any) -> Callable[_P, _R]:
    dispatcher = numba.njit(**options)(function)
    internals.set_cache(dispatcher, KernelCache(dispatcher, kernel_folder()))
    return cast('Callable[_P, _R]', dispatcher)
