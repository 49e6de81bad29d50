"""Named tuples of arrays passed by reference from kernel to kernel.

Numba passes each word of a tuple as an argument of its own: a hundred for the memory of a solver,
taken apart and put together again at every call. Here a call passes the address of a copy, which is
written where the variable is, and read once by the function that is called.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Any, Final

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core import ir as numba_ir
from numba.core.datamodel import register_default
from numba.core.datamodel.models import ProxyModel
from numba.extending import unbox

from cmpsp_ros.mpsp.jit.record_arrays import RecordLower

_FEW: Final = 2  # arrays, and tuples, that are passed by their words


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


class ReferenceLower(RecordLower):
    """Translation of a function whose arguments are passed by reference where they are large."""

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


def _addresses(builder: Any) -> dict[int, Any]:
    """Addresses of the copies of values, in the function that is being translated."""
    function = builder.function
    if not hasattr(function, 'addresses_of_copies'):
        function.addresses_of_copies = {}
    found: dict[int, Any] = function.addresses_of_copies
    return found
