"""One parameter: its type and range, and how a given value is read."""

from __future__ import annotations

import array
import math
import sys
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from types import SimpleNamespace
from typing import Any, Final, Literal, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from cmpsp_ros.parameters.errors import ParameterError, Problem, describe
from cmpsp_ros.setting import ANY, Range, settings_of

T = TypeVar('T')

Node = Literal['guidance', 'sim']

NAME: Final = '<name>'  # stands in a parameter's name for the names that the user lists


class ParameterType(Enum):
    """Types of parameters, by ROS's names for them; the values are for documentation."""

    BOOL = 'bool'
    INTEGER = 'int'
    DOUBLE = 'float'
    STRING = 'string'
    DOUBLE_ARRAY = 'floats'
    STRING_ARRAY = 'strings'

    @property
    def item(self) -> ParameterType:
        """Type of an item of an array; any other type itself."""
        singles = {self.DOUBLE_ARRAY: self.DOUBLE, self.STRING_ARRAY: self.STRING}
        return singles.get(self, self)


class Required(Enum):
    """The default of a required parameter."""

    REQUIRED = 'required'


REQUIRED: Final = Required.REQUIRED


@dataclass(frozen=True)
class Parameter:
    """One row of the table."""

    name: str  # its key, with ``<name>`` in place of a name listed by the user
    type: ParameterType
    default: Any  # Value when none is given, or ``REQUIRED``. Text may be empty if this is.
    unit: str  # SI unit, empty when there is none
    description: str  # one or more sentences for the table
    group: str  # heading under which it is documented
    nodes: frozenset[Node]  # nodes that use it
    range: Range = ANY  # of its numbers
    choices: tuple[str, ...] = ()  # its possible texts; empty for any
    length: int | None = None  # length of an array; None for any
    reconfigurable: bool = True  # whether it may be changed while a node runs

    @property
    def is_block(self) -> bool:
        """True if there is one such parameter for each name that the user lists."""
        return NAME in self.name

    @property
    def is_array(self) -> bool:
        """True if its values are lists."""
        return self.type.item is not self.type

    @property
    def prefix(self) -> str:
        """The part before ``<name>``; the whole name if there is none."""
        return self.name.partition(NAME)[0]

    def key(self, name: str) -> str:
        """The parameter's key for a name that the user listed."""
        return self.name.replace(NAME, name)

    @property
    def wanted(self) -> str:
        """Values that it accepts, in words."""
        unit = f' [{self.unit}]' if self.unit else ''
        within = f' {self.range}' if str(self.range) else ''
        length = '' if self.length is None else f'{self.length} '
        return {
            ParameterType.BOOL: 'true or false',
            ParameterType.INTEGER: f'an integer{within}{unit}',
            ParameterType.DOUBLE: f'a number{within}{unit}',
            ParameterType.STRING: ' or '.join(self.choices)
            or ('text' if self.default == '' else 'text, not empty'),
            ParameterType.DOUBLE_ARRAY: f'a list of {length}numbers{within}{unit}',
            ParameterType.STRING_ARRAY: f'a list of {length}different names',
        }[self.type]

    def read(self, key: str, value: object) -> Any:
        """A value of YAML, Python or rclpy as the parameter's type, or ParameterError."""
        plain = _plain(value)
        result = self._list(plain) if self.is_array else self._item(plain)
        if result is None:
            raise ParameterError(Problem(key, describe(plain), self.wanted + self._hint(plain)))
        return result

    def read_default(self, key: str) -> Any:
        """Copy of the default; raises ParameterError if there is none."""
        if self.default is REQUIRED:
            raise ParameterError(Problem(key, 'nothing', self.wanted))
        return list(self.default) if isinstance(self.default, (list, tuple)) else self.default

    def _list(self, value: object) -> list[Any] | None:
        # ROS gives an empty list no type, and hands it over as nothing at all.
        given = [] if value is None else value
        if not isinstance(given, list) or self.length not in (None, len(given)):
            return None
        items = [self._item(each) for each in given]
        is_set = self.type is ParameterType.STRING_ARRAY
        return None if None in items or (is_set and len(set(items)) < len(items)) else items

    def _item(self, value: object) -> Any:
        """One value of the parameter's type, or of its items; None where it is none."""
        kind = self.type.item
        if kind is ParameterType.STRING:
            return self._text(value)
        if (kind is ParameterType.BOOL) != isinstance(value, bool):
            return None
        if kind is ParameterType.BOOL:
            return value
        if kind is ParameterType.INTEGER:
            fits = isinstance(value, int) and -(2**63) <= value < 2**63 and value in self.range
            return value if fits else None
        if not isinstance(value, (int, float)):
            return None
        try:
            number = float(value)
        except OverflowError:
            return None
        return number if math.isfinite(number) and number in self.range else None

    def _text(self, value: object) -> str | None:
        if value == '' == self.default:
            return ''
        # ROS hands texts on through C: no zero, no half of a surrogate pair would arrive.
        if not isinstance(value, str) or not value.strip() or not value.isprintable():
            return None
        return str(value) if not self.choices or value in self.choices else None

    def _hint(self, value: object) -> str:
        """Advice on the quotes of a value in YAML."""
        kind = self.type.item
        for item in value if isinstance(value, list) else [value]:
            if kind is ParameterType.STRING:
                if isinstance(item, (bool, int, float)):
                    return ' (put it in quotes to make it text)'
            elif isinstance(item, str) and (written := _unquoted(item, kind)):
                return f' (this is text: write {written} without quotes)'
        return ''


class Group:
    """Parameters under one heading, those of these nodes unless `nodes` names others."""

    def __init__(self, heading: str, *nodes: Node) -> None:
        self._heading, self._nodes = heading, nodes

    def __call__(
        self, name: str, type_: ParameterType, default: object, unit: str, text: str, **rest: Any
    ) -> Parameter:
        """Make one; `rest` as in `Parameter`."""
        nodes = frozenset(rest.pop('nodes', self._nodes))
        return Parameter(name, type_, default, unit, text, self._heading, nodes, **rest)

    def of(
        self, kind: type, prefix: str = '', only: Collection[str] = (), **rest: Any
    ) -> Iterator[Parameter]:
        """Parameters of the settings that a dataclass declares, or of `only` some fields."""
        declared = settings_of(kind)
        hints = _annotations(kind, declared)
        for field, each in declared.items():
            if not only or field in only:
                type_, shape = _type_of(hints[field])
                default = getattr(kind, field)
                yield self(
                    each.key or f'{prefix}{field}',
                    type_,
                    list(default) if isinstance(default, tuple) else default,
                    each.unit,
                    each.description,
                    range=each.range,
                    reconfigurable=each.live,
                    **shape,
                    **rest,
                )


def build(kind: type[T], values: Mapping[str, Any], prefix: str = '', **rest: Any) -> T:
    """A dataclass with the settings that it declares from values by key, and other fields."""
    found = {
        name: values[each.key or f'{prefix}{name}'] for name, each in settings_of(kind).items()
    }
    return kind(**{k: tuple(v) if isinstance(v, list) else v for k, v in found.items()}, **rest)


def _annotations(kind: type, names: Iterable[str]) -> dict[str, Any]:
    """Types of some fields; those of others may be known to a type checker only."""
    some = SimpleNamespace(__annotations__={each: kind.__annotations__[each] for each in names})
    return get_type_hints(some, vars(sys.modules[kind.__module__]))


def _type_of(hint: Any) -> tuple[ParameterType, dict[str, Any]]:
    """Type of a parameter, with its choices or its length."""
    if hint in _TYPES:
        return _TYPES[hint], {}
    parts = get_args(hint)
    if get_origin(hint) is Literal:
        return ParameterType.STRING, {'choices': parts}
    is_text = parts[0] is str
    shape = {} if parts[-1] is ... else {'length': len(parts)}
    return ParameterType.STRING_ARRAY if is_text else ParameterType.DOUBLE_ARRAY, shape


_TYPES: Final = {
    bool: ParameterType.BOOL,
    int: ParameterType.INTEGER,
    float: ParameterType.DOUBLE,
    str: ParameterType.STRING,
}


def _plain(value: object) -> object:
    """The value without numpy and the like, one level deep."""
    if isinstance(value, (np.ndarray, np.generic, array.array)):
        return value.tolist()
    if isinstance(value, (list, tuple)):
        return [item.tolist() if isinstance(item, np.generic) else item for item in value]
    return value


def _unquoted(text: str, kind: ParameterType) -> str:
    """The bool or number that a text writes; empty where it writes none."""
    if kind is ParameterType.BOOL:
        return text.lower() if text.lower() in ('true', 'false') else ''
    try:
        number = float(text)
    except ValueError:
        return ''
    # In YAML as ROS reads it an underscore makes text; Python leaves it out.
    if '_' in text or not math.isfinite(number):
        return ''
    is_whole = kind is ParameterType.INTEGER and number.is_integer()
    return str(int(number) if is_whole else number)
