"""The parameters of a recorded guidance node over time."""

from collections.abc import Mapping
from typing import Any

from cmpsp_ros.bags.custom_data import plain_values
from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.parameters import TABLE, ParameterError, Values, is_of_ros

EVENTS = '/parameter_events'  # topic of the changes


class NodeParameters:
    """The complete set of parameters of one node, from its start on."""

    values: Values  # after all changes applied so far
    given: frozenset[str]  # keys that were recorded; the others are defaults

    def __init__(self, bag: Bag, node: str) -> None:
        self._path, self._node = bag.path, node
        self._restarts = list(bag.restarts.get(node, ()))
        if node not in bag.parameters:
            there = ', '.join(sorted(bag.parameters)) or 'no node'
            foreign = f'{node}/decision' not in bag.topics
            hint = ', and no decisions: --params-file makes some' if foreign else ''
            text = f'no parameters of {node}; there are those of {there}{hint}'
            raise BagError(f'{bag.path}: {text}')
        self._take(bag.parameters[node])

    def restart(self, until: int) -> int | None:
        """Take the parameters of the next restart until a time [ns]; returns its time, or None."""
        if not self._restarts or self._restarts[0][0] > until:
            return None
        since, given = self._restarts.pop(0)
        self._take(given)
        return since

    def change(self, received: int, changes: Mapping[str, Any], *, used: bool) -> None:
        """Apply a change received at a time [ns]; previous values that were used must be known."""
        unknown = sorted(changes.keys() - self.given)
        if used and unknown:
            raise BagError(
                f'{self._path}: found a change of {unknown[0]} of {self._node} at {received} ns,'
                ' before the recorder could learn what it was; wanted its value from the beginning'
            )
        try:
            self.values = TABLE.reconfigure(self.values, changes)
        except ParameterError as error:
            raise BagError(
                f'{self._path}: change of parameters at {received} ns: {error.problems[0]}'
            ) from error
        self.given = self.given.union(changes)

    def _take(self, given: Mapping[str, Any]) -> None:
        try:
            self.values = TABLE.resolve(given)
        except ParameterError as error:
            raise BagError(
                f'{self._path}: parameters of {self._node}: {error.problems[0]}'
            ) from error
        self.given = frozenset(given)


def changes_in(event: Any, node: str) -> dict[str, Any] | None:
    """New values by key in a message of `/parameter_events`; None for no change of this node."""
    if event.node != node or not event.changed_parameters:
        return None
    changed = plain_values(event.changed_parameters)
    return {key: value for key, value in changed.items() if not is_of_ros(key)}
