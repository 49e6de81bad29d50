"""Comparison of a replayed decision with the recorded one, field by field."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass

from cmpsp_ros.bags.decision_record import DecisionRecord
from cmpsp_ros.guidance import FIELDS, Decision, decision_to_key_values, waypoints
from cmpsp_ros.robots import with_side

Pairs = Iterator[tuple[str, str | None, str | None]]

_COMPARED = [key for each in FIELDS.values() if not each.is_input for key in each.keys]

_NUMBER = re.compile(r'-?\d+(\.\d+)?(e[+-]?\d+)?')
_FRACTION = re.compile(r'-?(\d+\.\d+(e[+-]?\d+)?|\d+e[+-]?\d+|inf|nan)')


@dataclass(frozen=True)
class Difference:
    """A difference between replay and recording.

    Attributes:
        number: Number of the decision in the bag, from 1.
        stamp: Stamp of the odometry that it is based on [ns].
        field: The field that differs.
        recorded: Its recorded value.
        replayed: Its replayed value.
    """

    number: int
    stamp: int
    field: str
    recorded: str
    replayed: str

    def __str__(self) -> str:
        """The difference in one line."""
        return (
            f'decision {self.number} (stamp {self.stamp} ns): {self.field}:'
            f' recorded {self.recorded}, replayed {self.replayed}'
        )


class Comparison:
    """Compares bit by bit, or floats within a tolerance."""

    def __init__(self, tolerance: float | None = None) -> None:
        """Choose how.

        Args:
            tolerance: Up to which difference floats count as equal: relative, and below 1
                absolute; None for bit by bit. Numbers in sentences are then left out.
        """
        self._tolerance = tolerance

    def differences(
        self, number: int, recorded: DecisionRecord, decision: Decision
    ) -> Iterator[Difference]:
        """Iterate over the fields that differ, computing times excepted."""
        for field, one, other in _pairs(recorded, decision):
            if one != other and not self._close(one, other):
                yield Difference(
                    number, recorded.stamp, field, one or 'nothing', other or 'nothing'
                )

    def _close(self, recorded: str | None, replayed: str | None) -> bool:
        if self._tolerance is None or recorded is None or replayed is None:
            return False
        if _FRACTION.fullmatch(recorded) and _FRACTION.fullmatch(replayed):
            one, other = float(recorded), float(replayed)
            return math.isclose(one, other, rel_tol=self._tolerance, abs_tol=self._tolerance)
        if ' ' in recorded:
            return _NUMBER.sub('#', recorded) == _NUMBER.sub('#', replayed)
        return False


def _pairs(recorded: DecisionRecord, decision: Decision) -> Pairs:
    """Every field, as recorded and as decided, in text."""
    now = decision_to_key_values(decision)
    for key in _COMPARED:
        yield key, recorded.entries.get(key), now.get(key)
    yield 'reason', recorded.reason, decision.reason
    if recorded.command is not None:
        names = ('command.linear.x', 'command.linear.y', 'command.angular.z')
        twist = with_side(decision.twist).tolist()
        for name, one, other in zip(names, recorded.command, twist, strict=True):
            yield name, repr(one), repr(other)
    if recorded.path is not None:
        yield from _waypoint_pairs(recorded, decision)


def _waypoint_pairs(recorded: DecisionRecord, decision: Decision) -> Pairs:
    path, plan = recorded.path or (), decision.plan
    points = () if plan is None else waypoints(plan)
    yield 'plan.poses', str(len(path)), str(len(points))
    # They are mostly equal, and many.
    if tuple(points) == path:
        return
    for index, (one, other) in enumerate(zip(path, points, strict=False)):
        for name, first, second in zip(('x', 'y', 'turn.z', 'turn.w'), one, other, strict=True):
            yield f'plan.poses[{index}].{name}', repr(first), repr(second)
