"""Small arrays on the stack, which compiled code can keep in registers.

What a sweep hands from stage to stage would otherwise be written to memory and read again, which
takes longer than the arithmetic between.
"""

from __future__ import annotations

from typing import Any

from numba import types
from numba.core import cgutils
from numba.core.errors import TypingError
from numba.extending import intrinsic


@intrinsic  # type: ignore[untyped-decorator]  # numba has no types
def room_for(_context: Any, like: Any) -> Any:
    """An array of the type and shape of a record's, with anything in it.

    It is gone when the function returns that asked for it.
    """
    if not isinstance(like, types.NestedArray):
        raise TypingError(f'found {like}, wanted an array in a record')
    return like(like), _on_stack


def _on_stack(context: Any, builder: Any, signature: Any, _arguments: Any) -> Any:
    kind = signature.return_type
    array = context.make_array(kind)(context, builder)
    element = context.get_data_type(kind.dtype)
    memory = cgutils.alloca_once(builder, element, kind.nitems)
    sizes = [
        [context.get_constant(types.intp, each) for each in of]
        for of in (kind.shape, kind.strides)
    ]
    array.data = memory
    array.shape, array.strides = (cgutils.pack_array(builder, each) for each in sizes)
    array.nitems = context.get_constant(types.intp, kind.nitems)
    array.itemsize = context.get_constant(types.intp, kind.size // kind.nitems)
    array.meminfo = cgutils.get_null_value(array.meminfo.type)
    array.parent = cgutils.get_null_value(array.parent.type)
    return array._getvalue()  # noqa: SLF001 (numba's way)
