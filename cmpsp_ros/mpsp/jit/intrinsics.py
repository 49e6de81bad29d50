"""Inner products in vector registers and small arrays on the stack, which numba does not offer.

A compiler may not reorder a sum without changing its bits, so it adds the products one by one. Here
the order is laid down: eight sums run side by side, those of the entries ``i``, ``i + 8``, ``i +
16`` and so on, as two vectors of four. Where registers are shorter the compiler takes more of them
for the same sums.

Values that a sweep hands from stage to stage stay in registers in an array on the stack; writing
them to memory and reading them again takes longer than the arithmetic between.
"""

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.errors import TypingError
from numba.extending import intrinsic

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit.compiled import allocation_free

_FOUR = ir.VectorType(ir.DoubleType(), 4)
_ROW = types.float64, 1, 'C'


@allocation_free
def dot(a: Array, b: Array, length: int) -> float:
    """Inner product of the leading entries of two contiguous rows."""
    whole = length - length % 8
    total: float = _by_eights(a, b, whole) if whole else 0.0
    for i in range(whole, length):
        total += a[i] * b[i]
    return total


@intrinsic  # type: ignore[untyped-decorator]  # numba has no types
def _by_eights(_context: Any, a: Any, b: Any, length: Any) -> Any:
    """Inner product of so many leading entries, a multiple of eight."""
    if not all((each.dtype, each.ndim, each.layout) == _ROW for each in (a, b)):
        raise TypingError(f'found {a} and {b}, wanted contiguous rows of float64')
    return types.float64(a, b, length), _sum_by_eights


def _sum_by_eights(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
    rows = [
        context.make_array(kind)(context, builder, row).data
        for kind, row in zip(signature.args[:2], arguments[:2], strict=True)
    ]
    sums = [cgutils.alloca_once_value(builder, ir.Constant(_FOUR, [0.0] * 4)) for _ in range(2)]
    length = arguments[2]
    zero, eight = ir.Constant(length.type, 0), ir.Constant(length.type, 8)
    with cgutils.for_range_slice(builder, zero, length, eight, inc=True) as (first, _):
        for half, total in enumerate(sums):
            begin = builder.add(first, ir.Constant(length.type, 4 * half))
            x, y = (_load(builder, row, begin) for row in rows)
            builder.store(builder.fadd(builder.load(total), builder.fmul(x, y)), total)
    lanes = builder.fadd(*(builder.load(total) for total in sums))
    parts = [builder.extract_element(lanes, ir.IntType(32)(lane)) for lane in range(4)]
    return builder.fadd(builder.fadd(*parts[:2]), builder.fadd(*parts[2:]))


def _load(builder: Any, row: Any, begin: Any) -> Any:
    """Four entries of a row; rows begin anywhere."""
    place = builder.bitcast(builder.gep(row, [begin]), _FOUR.as_pointer())
    return builder.load(place, align=8)


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
        [context.get_constant(types.intp, each) for each in of] for of in (kind.shape, kind.strides)
    ]
    array.data = memory
    array.shape, array.strides = (cgutils.pack_array(builder, each) for each in sizes)
    array.nitems = context.get_constant(types.intp, kind.nitems)
    array.itemsize = context.get_constant(types.intp, kind.size // kind.nitems)
    array.meminfo = cgutils.get_null_value(array.meminfo.type)
    array.parent = cgutils.get_null_value(array.parent.type)
    return array._getvalue()  # noqa: SLF001 (numba's way)


@intrinsic  # type: ignore[untyped-decorator]  # numba has no types
def call_with_data(_context: Any, address: Any, arrays: Any, count: Any) -> Any:
    """Call a function of C, of the addresses of contiguous arrays' data and a number."""

    def generate(context: Any, builder: Any, signature: Any, given: Any) -> Any:
        members = cgutils.unpack_tuple(builder, given[1])
        data = [
            builder.bitcast(
                context.make_array(kind)(context, builder, each).data, cgutils.voidptr_t
            )
            for kind, each in zip(signature.args[1].types, members, strict=True)
        ]
        kinds = [each.type for each in (*data, given[2])]
        function = ir.FunctionType(ir.VoidType(), kinds).as_pointer()
        builder.call(builder.inttoptr(given[0], function), [*data, given[2]])
        return context.get_dummy_value()

    return types.none(address, arrays, count), generate
