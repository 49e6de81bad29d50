"""Access to elements of arrays, and to arrays in records, in few instructions.

Numba fills a description of an array in memory before each access: some sixty instructions for
``stage.A[i, j]``, which the optimiser has to take out again. Here shape and strides of an array in
a record are constants, and of others only what an access needs is read. Addresses are the same.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core import ir as numba_ir
from numba.core.lowering import Lower
from numba.np.arrayobj import fix_integer_index, load_item, store_item

_ELEMENTS = types.Number, types.Boolean


class RecordLower(Lower):  # type: ignore[misc]  # numba has no types
    """Translation of a function."""

    def lower_expr(self, resty: Any, expr: Any) -> Any:
        """Translate an expression."""
        found = None
        if expr.op == 'getattr':
            found = self._attribute(self.typeof(expr.value.name), expr)
        elif expr.op in {'getitem', 'static_getitem'}:
            kind = self.typeof(expr.value.name)
            if isinstance(kind, types.Array) and resty == kind.dtype:
                index = expr.index if expr.op == 'getitem' else expr.index_var
                address = self._address(kind, expr.value, index)
                if address is not None:
                    found = load_item(self.context, self.builder, kind, address)
        return super().lower_expr(resty, expr) if found is None else found

    def lower_inst(self, inst: Any) -> Any:
        """Translate a statement."""
        if isinstance(inst, (numba_ir.SetItem, numba_ir.StaticSetItem)):
            kind = self.typeof(inst.target.name)
            if isinstance(kind, types.Array) and isinstance(kind.dtype, _ELEMENTS):
                index = inst.index if isinstance(inst, numba_ir.SetItem) else inst.index_var
                value, given = self.loadvar(inst.value.name), self.typeof(inst.value.name)
                address = self._address(kind, inst.target, index) if _is_number(given) else None
                if address is not None:
                    value = self.context.cast(self.builder, value, given, kind.dtype)
                    store_item(self.context, self.builder, kind, value, address)
                    return None
        return super().lower_inst(inst)

    def _attribute(self, kind: Any, expr: Any) -> Any:
        """An array of a record, or its shape; None for other attributes."""
        context, builder = self.context, self.builder
        if isinstance(kind, types.NestedArray) and expr.attr == 'shape':
            return _integers(context, kind.shape)
        if not isinstance(kind, types.Record) or expr.attr not in kind.fields:
            return None
        array = kind.typeof(expr.attr)
        if not isinstance(array, types.NestedArray):
            return None
        context.sentry_record_alignment(kind, expr.attr)
        model = context.data_model_manager[array]
        data = cgutils.get_record_member(
            builder,
            self.loadvar(expr.value.name),
            kind.offset(expr.attr),
            context.get_data_type(array.dtype),
        )
        known = {
            'nitems': context.get_constant(types.intp, array.nitems),
            'itemsize': context.get_constant(types.intp, array.size),
            'shape': _integers(context, array.shape),
            'strides': _integers(context, array.strides),
        }
        whole = model.get_value_type()
        parts = [
            known.get(name, ir.Constant(part, None))
            for name, part in zip(model._fields, whole.elements, strict=True)
        ]
        return builder.insert_value(
            ir.Constant(whole, parts), data, model.get_field_position('data')
        )

    def _address(self, kind: Any, array: Any, index: Any) -> Any:
        """Address of an element; None where an index is not a number for each dimension."""
        given = None if index is None else self.typeof(index.name)
        kinds = tuple(given.types) if isinstance(given, types.BaseTuple) else (given,)
        if len(kinds) != kind.ndim or not all(isinstance(each, types.Integer) for each in kinds):
            return None
        builder, value = self.builder, self.loadvar(index.name)
        indices = cgutils.unpack_tuple(builder, value) if given is not kinds[0] else [value]
        data, shape, strides = self._description(kind, self.loadvar(array.name))
        fixed = [self._index(*each) for each in zip(kinds, indices, shape, strict=True)]
        layout = kind.layout
        if layout == 'C' and isinstance(kind.dtype, types.Record):
            # By bytes, since a size that is in a type cannot be left open (`sizes`).
            layout = 'A'
            strides[-1] = self.context.get_constant(types.intp, kind.dtype.size)
            for i in range(kind.ndim - 1, 0, -1):
                strides[i - 1] = builder.mul(strides[i], shape[i])
        return cgutils.get_item_pointer2(self.context, builder, data, shape, strides, layout, fixed)

    def _index(self, kind: Any, index: Any, size: Any) -> Any:
        if isinstance(kind, types.IntegerLiteral) and kind.literal_value >= 0:
            return self.context.get_constant(types.intp, kind.literal_value)
        return fix_integer_index(self.context, self.builder, kind, index, size)

    def _description(self, kind: Any, array: Any) -> tuple[Any, list[Any], list[Any]]:
        """Address of the first element, shape and strides."""
        context, builder = self.context, self.builder
        position = context.data_model_manager[kind].get_field_position
        data = builder.extract_value(array, position('data'))
        if isinstance(kind, types.NestedArray):
            shape, strides = (
                [context.get_constant(types.intp, each) for each in of]
                for of in (kind.shape, kind.strides)
            )
            return data, shape, strides
        shape, strides = (
            [builder.extract_value(array, (position(name), i)) for i in range(kind.ndim)]
            for name in ('shape', 'strides')
        )
        return data, shape, strides


def _is_number(kind: Any) -> bool:
    return isinstance(kind, _ELEMENTS)


def _integers(context: Any, values: tuple[int, ...]) -> Any:
    numbers = [context.get_constant(types.intp, each) for each in values]
    return ir.Constant(ir.ArrayType(numbers[0].type, len(numbers)), numbers)
