"""One way to compile a numerical kernel, so that all share their flags and cache, and to call it.

`entry_for` gives Python the machine code for one signature without numba's dispatch. `address_of`
and `call` do the same for compiled code: the caller neither links nor optimises the callee, so
that a loop over compiled functions is compiled in a second, however long they take.
"""

from collections.abc import Callable
from typing import Any, Final, ParamSpec, TypeVar, cast

import numpy as np
from numba import types
from numba.core import cgutils
from numba.core.errors import TypingError
from numba.extending import intrinsic

from cmpsp_ros.mpsp.jit.cache import KernelCache, kernel_folder
from cmpsp_ros.mpsp.jit.kernel import Kernel
from cmpsp_ros.mpsp.jit.lowering import passed

ALLOCATION_FREE: Final = {'_nrt': False, 'error_model': 'numpy'}
"""Options of numba for functions that allocate nothing.

Division by zero gives what IEEE 754 says: to look for it at every division takes a tenth of the
solver's time, and results are checked to be finite where it counts.
"""

_signatures: Final[dict[Any, tuple[Any, ...]]] = {}
_RETURNED: Final[dict[type | None, Any]] = {
    None: types.none,
    int: types.int64,
    float: types.float64,
}

_P = ParamSpec('_P')
_R = TypeVar('_R')


def _compile(function: Callable[_P, _R], **more: Any) -> Callable[_P, _R]:
    """Compile with numba, cached on disk; no fast-math, for the same bits on all processors."""
    options = more | ALLOCATION_FREE
    kernel = Kernel(function, options, lambda made: KernelCache(made, kernel_folder()))
    return cast('Callable[_P, _R]', kernel)


def allocation_free(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile a function that makes no array, else an error, without slow reference counts."""
    return _compile(function)


def inlined(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile an `allocation_free` function into its callers: passing arguments takes longer."""
    return _compile(function, forceinline=True)


def inner(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Compile an `allocation_free` function without an entry for Python."""
    return _compile(function, no_cpython_wrapper=True)


def entry_for(function: Callable[_P, _R], *arguments: Any) -> Callable[_P, _R]:
    """Machine code of a compiled function for arguments like these, without numba's slow dispatch.

    Types and array layouts of all calls must be the same: nothing checks it.
    """
    kernel: Any = function
    return cast('Callable[_P, _R]', kernel.entry(_signature(kernel, arguments)))


def address_of(returned: type | None, function: Callable[..., Any], *arguments: Any) -> int:
    """Address of a compiled function's machine code, for example arguments.

    Raises:
        TypeError: The result is not `returned`: int (or an `IntEnum`), float or None.
    """
    kernel: Any = function
    signature = _signature(kernel, arguments)
    address, kind = kernel.address(signature)
    found, wanted = types.unliteral(kind), _RETURNED[returned]
    if isinstance(found, types.IntEnumMember):
        found = found.dtype
    if found != wanted:
        raise TypeError(f'{function.__name__}: found {found} returned, wanted {wanted}')
    return int(address)


def words_of(value: Any) -> list[int]:
    """Memory of a tuple of arrays as compiled code passes it by reference, in words of 8 bytes.

    Raises:
        TypeError: Something else than arrays is in it.
    """
    if isinstance(value, tuple):
        return [word for each in value for word in words_of(each)]
    if not isinstance(value, np.ndarray):
        raise TypeError(f'found {value!r}, wanted an array')
    # Numba's description; the first two are for counts of references.
    return [0, 0, value.size, value.itemsize, value.ctypes.data, *value.shape, *value.strides]


def _signature(kernel: Any, arguments: tuple[Any, ...]) -> tuple[Any, ...]:
    """Numba's types of arguments; a law asks hundreds of times when it is configured."""
    key = kernel, _kind(arguments)
    if key not in _signatures:
        _signatures[key] = tuple(kernel.typeof_pyval(argument) for argument in arguments)
    return _signatures[key]


def _kind(value: Any) -> Any:
    """All that a type depends on; numba takes milliseconds to tell that of a few records."""
    if isinstance(value, np.ndarray):
        flags = value.flags
        layout = flags.c_contiguous, flags.f_contiguous, flags.writeable, flags.aligned
        return value.dtype, value.ndim, layout
    return (type(value), *map(_kind, value)) if isinstance(value, tuple) else type(value)


@intrinsic  # type: ignore[untyped-decorator]  # numba has no types
def tuple_at(_context: Any, address: Any) -> Any:
    """Reference to the tuple whose `words_of` are at an address, as an argument of `call`."""

    def generate(_context: Any, builder: Any, _signature: Any, values: Any) -> Any:
        return builder.inttoptr(values[0], cgutils.voidptr_t)

    return types.voidptr(address), generate


def _calls(returned: Any) -> Any:
    @intrinsic  # type: ignore[untyped-decorator]  # numba has no types
    def call(_context: Any, address: Any, arguments: Any) -> Any:
        if not isinstance(arguments, types.BaseTuple):
            raise TypingError(f'found {arguments}, wanted a tuple of arguments')
        kinds = passed(arguments.types)

        def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
            convention = context.call_conv
            kind = convention.get_function_type(returned, kinds)
            function = builder.inttoptr(values[0], kind.as_pointer())
            given = cgutils.unpack_tuple(builder, values[1])
            return convention.call_function(builder, function, returned, kinds, given)[1]

        return returned(address, arguments), generate

    return call


# ``call(address, arguments)`` calls a function that returns nothing.
#
# The arguments must have the very same types as those of `address_of`.
call: Final = _calls(types.none)

call_for_int: Final = _calls(types.int64)  # the same of one that returns an integer

call_for_float: Final = _calls(types.float64)  # the same of one that returns a number
