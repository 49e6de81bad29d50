"""Replay with a changed guidance law beside the recorded decisions, as bag and picture.

It is open-loop: the robot followed the recorded commands, not those of the changed law.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from cmpsp_ros.bags.decision_record import (
    CLOUD,
    DECISION,
    PATH,
    TWIST,
    DecisionRecord,
    command_message,
    decision_message,
    path_message,
    tracks_message,
)
from cmpsp_ros.bags.errors import UnknownTypeError
from cmpsp_ros.bags.names import Names
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.bags.replay.inputs import Follower, Halted, Input, Inputs, OdometryReceived
from cmpsp_ros.bags.replay.recording import OdometrySample
from cmpsp_ros.bags.replay.sensor_inputs import SensorInputs
from cmpsp_ros.bags.writer import BagWriter
from cmpsp_ros.guidance import Decision, GuidanceSettings
from cmpsp_ros.guidance.messages import Track
from cmpsp_ros.parameters import TABLE, Values, guidance_settings
from cmpsp_ros.robots.motion import with_side
from cmpsp_ros.view import BAGS, GOAL, course, draw, show, traces

PREFIX = '/what_if'  # before the names of topics of the changed law
_PLANS_DRAWN = 4
_MARGIN = 0.5

_RECORDED, _CHANGED = BAGS[:2]


@dataclass(frozen=True)
class Change:
    """Values by key that replace those of a set, by default the recorded one as it changed."""

    base: Mapping[str, Any] | None
    assignments: Mapping[str, Any]

    def of(self, recorded: Values) -> Values:
        """The complete changed set, for a recorded one; raises `ParameterError`."""
        base = recorded if self.base is None else self.base
        return TABLE.resolve({**base, **self.assignments})


@dataclass
class WhatIf:
    """Two laws on the same odometry: the recorded one, and a changed one by its first settings."""

    settings: GuidanceSettings
    odometry: list[OdometrySample] = field(default_factory=list)
    recorded: list[DecisionRecord] = field(default_factory=list)
    # With the time of reception of their odometry [ns].
    decisions: list[tuple[int, Decision]] = field(default_factory=list)
    left_out: list[str] = field(default_factory=list)  # topics not copied

    def __str__(self) -> str:
        levels = {
            'recorded': Counter(each.level for each in self.recorded),
            'changed': Counter(each.level.name.lower() for _, each in self.decisions),
        }
        return '\n'.join(
            f'{who}: {counts.total()} decisions, '
            + ', '.join(f'{count} {level}' for level, count in sorted(counts.items()))
            for who, counts in levels.items()
            if counts
        )


def what_if(path: Path, names: Names, change: Change, output: Path) -> WhatIf:
    """Run the changed law, and write a new bag with the recording and its decisions.

    A bag without decisions needs a base of parameters: the law decides on its odometry and
    sensors, and the tracks that it used are written as well. Raises BagError or ParameterError.
    """

    def settings_of(values: Values) -> GuidanceSettings:
        return guidance_settings(change.of(values))

    with Bag(path) as bag:
        is_foreign = names.decision not in bag.topics and change.base is not None
        inputs = SensorInputs(bag, names, change.of({})) if is_foreign else Inputs(bag, names)
        result, follower = WhatIf(settings_of(inputs.values)), Follower(settings_of)
        for event in inputs:
            _take(event, follower, result)
        with BagWriter(output) as new:
            _copy(bag, new, result)
            for node, values in bag.parameters.items():
                if f'{node}/parameters' not in bag.topics:
                    new.set_parameters(node, values)
            new.set_parameters(f'{PREFIX}{names.node}', change.of(inputs.values))
            _write(new, names, result)
            if is_foreign:
                _write_tracks(new, f'{PREFIX}{names.tracks}', result)
    return result


def _take(event: Input, follower: Follower, result: WhatIf) -> None:
    try:
        decision = follower.follow(event)
    except Exception as error:
        if not isinstance(event, OdometryReceived):
            raise
        # A law that fails stops the robot, as it does in the node.
        reason = f'The guidance law failed: {type(error).__name__}: {error}'
        decision = follower.law.halt(event.odometry.stamp, reason)
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


def _write_tracks(new: BagWriter, topic: str, result: WhatIf) -> None:
    new.topic(topic, CLOUD)
    for received, decision in result.decisions:
        tracks = [each for each in decision.tracks if isinstance(each, Track)]
        new.write(topic, received, tracks_message(tracks, result.settings.frame_id, decision.stamp))


def draw_what_if(result: WhatIf, title: str, path: Path) -> None:
    """Draw commands over time and plans on the road, of both laws."""
    figure = Figure(figsize=(13.0, 6.5), layout='constrained')
    figure.suptitle(f'{title}\nOpen loop: the robot followed the recorded commands only.')
    grid = figure.add_gridspec(2, 2)
    above = figure.add_subplot(grid[0, 0])
    below = figure.add_subplot(grid[1, 0], sharex=above)
    _draw_commands((above, below), result)
    _draw_plans(figure.add_subplot(grid[:, 1]), result)
    figure.savefig(path, dpi=120)


def _draw_commands(axes: Sequence[Axes], result: WhatIf) -> None:
    commanded = [each for each in result.recorded if each.command is not None]
    decided = [each for _, each in result.decisions]
    begin = min(each[0].stamp for each in (result.recorded, decided) if each)
    before = np.array([each.stamp - begin for each in commanded]) / 1e9
    changed = np.array([each.stamp - begin for each in decided]) / 1e9
    recorded_twists = np.array([each.command for each in commanded]).reshape(-1, 3)
    twists = np.array([with_side(each.twist) for each in decided]).reshape(-1, 3)
    for one, index, name in zip(axes, (0, 2), ('speed [m/s]', 'turn rate [rad/s]'), strict=True):
        one.step(before, recorded_twists[:, index], where='post', color=_RECORDED, label='recorded')
        one.step(changed, twists[:, index], where='post', color=_CHANGED, ls='--', label='changed')
        one.set_ylabel(name)
        one.grid(alpha=0.3)
    axes[0].legend()
    axes[-1].set_xlabel('time since the first decision [s]')


def _draw_plans(axes: Axes, result: WhatIf) -> None:
    draw(axes, traces(course([result.settings.road], result.settings.obstacles), ''))
    driven = np.array([each.pose[:2] for each in result.odometry]).reshape(-1, 2)
    recorded = [np.array(each.path)[:, :2] for each in result.recorded if each.path]
    changed = [each.plan.poses[:, :2] for _, each in result.decisions if each.plan is not None]
    for plans, color, style, name in (
        (recorded, _RECORDED, '-', 'recorded plans'),
        (changed, _CHANGED, '--', 'changed plans'),
    ):
        for part in range(_PLANS_DRAWN if plans else 0):
            plan, label = plans[part * len(plans) // _PLANS_DRAWN], None if part else name
            axes.plot(*plan.T, style, color=color, lw=1.2, label=label, zorder=4)
    axes.plot(*driven.T, color='black', lw=2.0, label='driven, as recorded', zorder=3)
    axes.plot(*result.settings.goal, '*', color=GOAL, ms=14, label='goal', zorder=5)
    show(axes, [driven, np.array([result.settings.goal]), *recorded, *changed], _MARGIN)
    axes.legend(loc='best')
