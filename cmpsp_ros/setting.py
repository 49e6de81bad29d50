"""Settings declared where they are used: dataclass fields with default, unit, range and sentence.

The table of parameters, its documentation, the JSON schema and the declaration in ROS derive from
these fields.
"""

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

_KEY: Final = 'setting'


@dataclass(frozen=True)
class Range:
    """An interval of numbers; ends are included unless they are open."""

    low: float = -math.inf
    high: float = math.inf
    low_open: bool = False
    high_open: bool = False

    def __contains__(self, number: float) -> bool:
        above = number > self.low if self.low_open else number >= self.low
        below = number < self.high if self.high_open else number <= self.high
        return above and below

    def __str__(self) -> str:
        """Exact short text; empty for all numbers."""
        ends = []
        if self.low > -math.inf:
            ends.append(f'{">" if self.low_open else ">="} {self.low:.12g}')
        if self.high < math.inf:
            ends.append(f'{"<" if self.high_open else "<="} {self.high:.12g}')
        if len(ends) == 2 and not self.low_open and not self.high_open:
            return f'from {self.low:.12g} to {self.high:.12g}'
        return ' and '.join(ends)


ANY: Final = Range()
POSITIVE: Final = Range(low=0.0, low_open=True)
NOT_NEGATIVE: Final = Range(low=0.0)


class Setting(NamedTuple):
    """Declaration of a setting beside its name, type and default."""

    unit: str  # SI unit, empty for none
    description: str  # one or more sentences for the user
    range: Range  # range of its numbers
    live: bool  # true if it may be changed while a node runs
    key: str  # name of its parameter; empty for the name of the field


def setting(
    default: Any,
    unit: str,
    description: str,
    within: Range = ANY,
    *,
    live: bool = True,
    key: str = '',
) -> Any:
    """A dataclass field that is a parameter; type, choices and length are those of its annotation.

    Args:
        default: Default value.
        unit: As in `Setting`, like all others.
        description: Sentences.
        within: Range of its numbers.
        live: True if it may be changed while a node runs.
        key: Name of its parameter, if it is not that of the field.
    """
    declared = Setting(unit, description, within, live, key)
    return dataclasses.field(default=default, metadata={_KEY: declared})


def settings_of(kind: type) -> dict[str, Setting]:
    """The settings that a dataclass declares, by the names of their fields."""
    fields = dataclasses.fields(kind)
    return {each.name: each.metadata[_KEY] for each in fields if _KEY in each.metadata}
