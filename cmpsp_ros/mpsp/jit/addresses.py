"""Calls of machine code by its address: the caller neither links nor optimises what it calls.

So a loop over compiled functions is compiled in a second, however long they take. Signatures follow
from the arguments of a call, which must be of the very same types as those of `address_of`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from numba import types
from numba.core import cgutils
from numba.core.errors import TypingError
from numba.extending import intrinsic

from cmpsp_ros.mpsp.jit import internals
from cmpsp_ros.mpsp.jit.compiled import overload_for

_RETURNED: Final[dict[type | None, Any]] = {
    None: types.none,
    int: types.int64,
    float: types.float64,
}


def address_of(returned: type | None, function: Callable[..., Any], *arguments: Any) -> int:
    """Where the machine code of a compiled function is, for arguments of these types.

    Args:
        returned: What it returns: int, float or nothing.
        function: The function.
        arguments: Examples.

    Raises:
        TypeError: It returns something else.
    """
    overload = overload_for(function, arguments)
    found, wanted = types.unliteral(overload.signature.return_type), _RETURNED[returned]
    if found != wanted:
        raise TypeError(f'{function.__name__}: found {found} returned, wanted {wanted}')
    return internals.address(overload)


def _calls(returned: Any) -> Any:
    @intrinsic  # type: ignore[untyped-decorator]  # numba has no types
    def call(_context: Any, address: Any, arguments: Any) -> Any:
        if not isinstance(arguments, types.BaseTuple):
            raise TypingError(f'found {arguments}, wanted a tuple of arguments')
        kinds = tuple(arguments.types)

        def generate(context: Any, builder: Any, _signature: Any, values: Any) -> Any:
            convention = context.call_conv
            kind = convention.get_function_type(returned, kinds)
            function = builder.inttoptr(values[0], kind.as_pointer())
            given = cgutils.unpack_tuple(builder, values[1])
            return convention.call_function(builder, function, returned, kinds, given)[1]

        return returned(address, arguments), generate

    return call


call: Final = _calls(types.none)
"""``call(address, arguments)`` calls a function that returns nothing."""

call_for_int: Final = _calls(types.int64)
"""The same of one that returns an integer."""

call_for_float: Final = _calls(types.float64)
"""The same of one that returns a number."""
