"""What if: a changed guidance law on recorded odometry, beside the one that drove.

It is open-loop: the robot followed the recorded commands, not those of the changed law.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cmpsp_ros.bags.decision_record import DecisionRecord
from cmpsp_ros.bags.errors import UnknownTypeError
from cmpsp_ros.bags.messages import (
    DECISION,
    PATH,
    TWIST,
    command_message,
    decision_message,
    path_message,
)
from cmpsp_ros.bags.names import Names
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.bags.replay.follower import Follower
from cmpsp_ros.bags.replay.inputs import Halted, Input, Inputs, OdometryReceived
from cmpsp_ros.bags.replay.recording import OdometrySample
from cmpsp_ros.bags.writer import BagWriter
from cmpsp_ros.guidance import Decision, GuidanceSettings
from cmpsp_ros.parameters import TABLE, Values, guidance_settings

PREFIX = '/what_if'
"""Before the names of what the changed law says."""


@dataclass(frozen=True)
class Change:
    """The change to the recorded law.

    Attributes:
        base: A parameter set instead of the recorded one; None: the recorded one with its live
            changes.
        assignments: Values by key that replace those of the set.
    """

    base: Mapping[str, Any] | None
    assignments: Mapping[str, Any]

    def of(self, recorded: Values) -> Values:
        """The complete changed set, for a recorded one.

        Raises:
            ParameterError: It cannot be used.
        """
        base = recorded if self.base is None else self.base
        return TABLE.resolve({**base, **self.assignments})


@dataclass
class WhatIf:
    """Two laws on the same odometry.

    Attributes:
        settings: Of the changed law, at the beginning.
        odometry: All odometry received.
        recorded: Decisions of the recorded law.
        decisions: Decisions of the changed law, each with the time of reception of its odometry
            [ns].
        left_out: Topics that could not be copied.
    """

    settings: GuidanceSettings
    odometry: list[OdometrySample] = field(default_factory=list)
    recorded: list[DecisionRecord] = field(default_factory=list)
    decisions: list[tuple[int, Decision]] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        """Summary in a few lines."""
        return '\n'.join(
            f'{who}: {sum(counts.values())} decisions, '
            + ', '.join(f'{count} {level}' for level, count in sorted(counts.items()))
            for who, counts in zip(('recorded', 'changed'), self.levels, strict=True)
        )

    @property
    def levels(self) -> tuple[dict[str, int], dict[str, int]]:
        """Decisions of each fallback level: recorded, and of the changed law."""
        return (
            dict(Counter(each.level for each in self.recorded)),
            dict(Counter(each.level.name.lower() for _, each in self.decisions)),
        )


def what_if(path: Path, names: Names, change: Change, output: Path) -> WhatIf:
    """Run the changed law, and write a new bag with the recording and its decisions.

    Args:
        path: The recorded bag.
        names: Names of the recorded node and its topics.
        change: The change to the recorded law.
        output: Folder of the new bag; must not exist.

    Raises:
        BagError: The bag lacks what is needed, or the new one cannot be written.
        ParameterError: The changed parameters cannot be used.
    """

    def settings_of(values: Values) -> GuidanceSettings:
        return guidance_settings(change.of(values))

    with Bag(path) as bag:
        inputs = Inputs(bag, names)
        result, follower = WhatIf(settings_of(inputs.values)), Follower(settings_of)
        for event in inputs:
            _take(event, follower, result)
        with BagWriter(output) as new:
            _copy(bag, new, result)
            for node, values in bag.parameters.items():
                new.set_parameters(node, values)
            for node, restarts in bag.restarts.items():
                for since, values in restarts:
                    new.set_parameters(node, values, since)
            new.set_parameters(f'{PREFIX}{names.node}', change.of(inputs.values))
            _write(new, names, result)
    return result


def _take(event: Input, follower: Follower, result: WhatIf) -> None:
    decision = _decision(event, follower)
    match event:
        case OdometryReceived(odometry, recorded):
            received = odometry.received
            result.odometry.append(odometry)
            if recorded is not None:
                result.recorded.append(recorded)
        case Halted(recorded):
            received = recorded.received
            result.recorded.append(recorded)
        case _:
            return
    if decision is not None:
        result.decisions.append((received, decision))


def _decision(event: Input, follower: Follower) -> Decision | None:
    """The decision on an input; a law that fails stops the robot, as it does in the node."""
    try:
        return follower.follow(event)
    except Exception as error:
        if not isinstance(event, OdometryReceived):
            raise
        reason = f'The guidance law failed: {type(error).__name__}: {error}'
        return follower.law.halt(event.odometry.stamp, reason)


def _copy(bag: Bag, new: BagWriter, result: WhatIf) -> None:
    for name, topic in bag.topics.items():
        if name.startswith(f'{PREFIX}/'):
            continue
        try:
            new.topic(name, topic.msgtype, topic.qos_profiles)
        except UnknownTypeError:
            result.left_out.append(name)
            continue
        for stamp, raw in bag.raw(name):
            new.write(name, stamp, raw)


def _write(new: BagWriter, names: Names, result: WhatIf) -> None:
    decided, commanded, planned = (
        f'{PREFIX}{name}' for name in (names.decision, names.cmd_vel, names.path)
    )
    for topic, kind in ((decided, DECISION), (commanded, TWIST), (planned, PATH)):
        new.topic(topic, kind)
    for received, decision in result.decisions:
        new.write(decided, received, decision_message(decision, f'{PREFIX}{names.node}: decision'))
        new.write(commanded, received, command_message(decision))
        if decision.plan is not None:
            path = path_message(decision.plan, result.settings.frame_id, decision.stamp)
            new.write(planned, received, path)
