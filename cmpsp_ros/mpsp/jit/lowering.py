"""Translation of functions to LLVM's language in fewer instructions and arguments than numba's.

Numba passes each word of a tuple as an argument of its own: a hundred for the memory of a solver,
taken apart and put together again at every call. Here a call passes the address of a copy, which is
written where the variable is, and read once by the function that is called.

Numba fills a description of an array in memory before each access: some sixty instructions for
``stage.A[i, j]``, which the optimiser has to take out again. Here shape and strides of an array in
a record are constants, and of others only what an access needs is read. Addresses are the same.
"""

from collections import Counter
from collections.abc import Iterable
from typing import Any, Final

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core import ir as numba_ir
from numba.core.datamodel import register_default
from numba.core.datamodel.models import ProxyModel
from numba.core.lowering import Lower
from numba.extending import unbox
from numba.np.arrayobj import fix_integer_index, load_item, store_item

_FEW: Final = 2  # arrays, and tuples, that are passed by their words
_ELEMENTS: Final = types.Number, types.Boolean


class Reference(types.Type):  # type: ignore[misc]  # numba has no types
    """Numba's type of an argument that is passed by reference.

    Args:
        content: Type of the tuple.
    """

    def __init__(self, content: Any) -> None:
        self.content = content
        super().__init__(f'reference({content})')

    @property
    def key(self) -> Any:
        """Identity of the content."""
        return self.content.key


@register_default(Reference)
class _Model(ProxyModel):  # type: ignore[misc]  # numba has no types
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind)
        self._proxied_model = manager.lookup(kind.content)

    def get_argument_type(self) -> Any:
        """Type of an address."""
        return cgutils.voidptr_t

    def as_argument(self, builder: Any, value: Any) -> Any:
        """Address of a value."""
        address = _addresses(builder).get(id(value))
        if address is None:
            address = cgutils.alloca_once(builder, value.type)
            builder.store(value, address)
        return builder.bitcast(address, cgutils.voidptr_t)

    def from_argument(self, builder: Any, value: Any) -> Any:
        """Value at an address."""
        content = builder.load(builder.bitcast(value, self.get_value_type().as_pointer()))
        _addresses(builder)[id(content)] = value
        return content

    def traverse(self, builder: Any) -> Any:
        """Members, for counts of references."""
        return self._proxied_model.traverse(builder)

    def inner_models(self) -> Any:
        """Models of the members."""
        return self._proxied_model.inner_models()


@unbox(Reference)  # type: ignore[untyped-decorator]  # numba has no types
def _unbox(kind: Any, value: Any, context: Any) -> Any:
    return context.unbox(kind.content, value)


def passed(kinds: Iterable[Any]) -> tuple[Any, ...]:
    """The types by which arguments of some types are passed."""
    return tuple(Reference(each) if is_passed_by_reference(each) else each for each in kinds)


def is_passed_by_reference(kind: Any) -> bool:
    """True for named tuples of several arrays or tuples."""
    if not isinstance(kind, types.BaseNamedTuple):
        return False
    return sum(isinstance(each, (types.Array, types.BaseTuple)) for each in kind.types) > _FEW


class PartLower(Lower):  # type: ignore[misc]  # numba has no types
    """Translation of a function, whose arguments are passed by reference where they are large."""

    def __init__(self, context: Any, library: Any, fndesc: Any, *rest: Any, **named: Any) -> None:
        fndesc.argtypes = passed(fndesc.argtypes)
        self._copies: dict[str, Any] = {}
        self._assignments: Counter[str] = Counter()
        for block in rest[0].blocks.values():
            self._assignments.update(each.target.name for each in block.find_insts(numba_ir.Assign))
        super().__init__(context, library, fndesc, *rest, **named)

    def storevar(self, value: Any, name: str, argidx: int | None = None) -> None:
        """Store the value of a variable, and a copy for the functions that it is passed to."""
        super().storevar(value, name, argidx)
        if not is_passed_by_reference(self.typeof(name)):
            return
        source = _addresses(self.builder).get(id(value))
        if isinstance(source, ir.Argument) and self._assignments[name] == 1:
            self._copies[name] = source
            return
        if name not in self._copies:
            self._copies[name] = cgutils.alloca_once(self.builder, value.type)
        self.builder.store(value, self._copies[name])

    def loadvar(self, name: str) -> Any:
        """Load the value of a variable, and note where its copy is."""
        value = super().loadvar(name)
        if name in self._copies:
            _addresses(self.builder)[id(value)] = self._copies[name]
        return value

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


def _addresses(builder: Any) -> dict[int, Any]:
    """Addresses of the copies of values, in the function that is being translated."""
    function = builder.function
    if not hasattr(function, 'addresses_of_copies'):
        function.addresses_of_copies = {}
    found: dict[int, Any] = function.addresses_of_copies
    return found


def _is_number(kind: Any) -> bool:
    return isinstance(kind, _ELEMENTS)


def _integers(context: Any, values: tuple[int, ...]) -> Any:
    numbers = [context.get_constant(types.intp, each) for each in values]
    return ir.Constant(ir.ArrayType(numbers[0].type, len(numbers)), numbers)
