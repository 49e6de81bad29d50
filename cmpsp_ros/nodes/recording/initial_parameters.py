"""The values of a node's parameters before the first known change.

The recorder requests them, and the node publishes changes as events. Responses and events arrive
separately: a response may include a change and still arrive before its event. Used as the initial
value, it would date the change too early.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping


class InitialParameters:
    """What is known of the parameters of one node, from its start to its end.

    Calls follow the order of arrival: `asked`, `answered`, and in between and for a while after it
    `declared` and `changed`; then `settle`, once no event older than the answer can still arrive.

    Attributes:
        known: Values before the first change, by key. A key is missing if a change of it arrived
            before a response that is certainly older: its initial value is then unknown.
        latest: Values after all changes received, by key.
        settled: Whether a response has arrived, and all events that may be older.
    """

    def __init__(self) -> None:
        self.known: dict[str, Any] = {}
        self.latest: dict[str, Any] = {}
        self.settled = False
        self._changed: dict[str, list[Any]] = {}
        self._lost: set[str] = set()
        self._answer: dict[str, Any] | None = None

    def declared(self, key: str, value: Any) -> None:
        """A parameter was declared with this value."""
        if key not in self._lost and key not in self._changed:
            self.known.setdefault(key, value)
        self.latest.setdefault(key, value)

    def changed(self, key: str, value: Any) -> None:
        """Hear that a parameter has now this value."""
        if key not in self.known:
            self._changed.setdefault(key, []).append(value)
        self.latest[key] = value

    def asked(self) -> None:
        """The node was asked: its response is younger than all events received by now."""
        self._lost.update(self._changed)
        self._changed.clear()

    def answered(self, values: Mapping[str, Any]) -> None:
        """Keep an answer until `settle`."""
        self._answer = dict(values)

    def settle(self) -> None:
        """Decide which values of the answer are those of before the first change."""
        if self._answer is None:
            return
        for key, value in self._answer.items():
            after = [repr(each) for each in self._changed.get(key, ())]
            # It may be the value before a change, or the one after it.
            if key in self._lost or repr(value) in after:
                self._lost.add(key)
            else:
                self.known.setdefault(key, value)
            self.latest.setdefault(key, value)
        self._changed.clear()
        self._answer = None
        self.settled = True
