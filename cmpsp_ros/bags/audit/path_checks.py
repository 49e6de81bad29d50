"""Checks of the path: was it clear, feasible for the wheels, and did it end at the goal?"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import zip_longest

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.bags.audit.clearance import EDGES
from cmpsp_ros.bags.audit.finding import Verdict, passed_if, skipped
from cmpsp_ros.bags.audit.odometry import interpolated, wrapped
from cmpsp_ros.bags.audit.record import AuditRecord, Leg, RunSpan
from cmpsp_ros.bags.decision_record import DecisionRecord
from cmpsp_ros.bags.runs.encounters import Encounter
from cmpsp_ros.bags.runs.goals import Passing
from cmpsp_ros.guidance.goals import Goal
from cmpsp_ros.guidance.horizon import NANOSECONDS, to_nanoseconds
from cmpsp_ros.guidance.messages.odometry_gate import motion_limits
from cmpsp_ros.guidance.settings import GOAL, GuidanceSettings
from cmpsp_ros.robots.arcs import arc_ends
from cmpsp_ros.world.roads.arc_length import project_on_path

Array = NDArray[np.float64]


_ROUNDING = 1e-6
"""What rounding may take from a clearance [m]."""

_SAMPLE_TOLERANCE = 1e-3
"""What a linearised constraint may be short of at a sample [m]; see `guidance.audit`."""


def road(record: AuditRecord) -> Verdict:
    """Clearance from both road edges."""
    if not any(each.settings.road.has_center_line for each in record.sweeps):
        return skipped('There is no road (road.type is none).')
    return _clear(record, slice(0, EDGES), 0.0)


def obstacles(record: AuditRecord) -> Verdict:
    """Clearance from all obstacles."""
    if not any(each.settings.obstacles for each in record.sweeps):
        return skipped('There is no obstacle among the parameters.')
    return _clear(record, slice(EDGES, None), 0.0)


def moving(record: AuditRecord) -> Verdict:
    """Clearance from moving obstacles at their predicted positions, while the robot moved.

    A collision with a robot at rest is not its own.
    """
    met = record.encounters
    if not met:
        return skipped(f'No moving obstacle is in {record.places.moving}.')
    return _apart(record, met, ', at its predicted position')


def others(record: AuditRecord) -> Verdict:
    """Clearance from the other robots at their positions, while the robot moved.

    A collision with a robot at rest is not its own.
    """
    named = record.history.epochs[0].settings.moving_obstacles.others
    if not named:
        return skipped('No other robots are to be kept clear of (others.namespaces).')
    if not record.robot_encounters:
        return skipped(f'The bag tells not where {", ".join(named)} drove.')
    return _apart(record, record.robot_encounters, '')


def _apart(record: AuditRecord, met: Sequence[Encounter], where: str) -> Verdict:
    """The least clearance of some encounters."""
    worst, at, nearest = math.inf, record.start, ''
    stood = min(float(each.clearance[each.stands].min(initial=math.inf)) for each in met)
    for each in met:
        least = np.where(each.stands, math.inf, each.clearance)
        if least.min() < worst:
            worst, at = float(least.min()), int(each.stamps[least.argmin()])
            nearest = each.name
    if worst == math.inf:
        return skipped('The robot stands while anything moves.')
    passed = worst >= -_ROUNDING
    sentence = (
        f'Between samples too, the robot keeps {worst:.3g} m from {nearest}{where}.'
        if passed
        else f'Along the path driven, the robot cuts {nearest} by {-worst:.3g} m.'
    )
    if stood < 0.0:
        sentence += f' Something moves {-stood:.3g} m into it while it stands.'
    return passed_if(passed, sentence, worst=worst, limit=0.0, unit='m', at=record.seconds(at))


def margin(record: AuditRecord) -> Verdict:
    """Whether the margin asked for was kept as well."""
    wanted = max(each.settings.safety.margin for each in record.sweeps)
    if wanted == 0.0:
        return skipped('No margin was asked for (safety.margin is 0).')
    return _clear(record, slice(None), wanted)


def commanded(record: AuditRecord) -> Verdict:
    """The arc of each command, held for a control period from the pose where it takes effect.

    That is the pose of its odometry, or with `command_delay`, or with a delay or lag that was
    estimated, the one measured that much later. A robot that is too close already may only be
    commanded not to get closer.
    """
    worst, at, nearest = math.inf, record.start, ''
    estimates = {each.stamp: each for each in record.decisions}
    for leg in record.legs:
        commands = leg.commands.chosen(np.all(np.isfinite(leg.commands.twists), axis=1))
        settings_of = [record.history.at(int(stamp)) for stamp in commands.stamps]
        answered = [estimates.get(stamp) for stamp in commands.stamps.tolist()]
        delays = np.array(list(map(_effect_delay, settings_of, answered)))
        poses = _measured(leg, commands.stamps, delays)
        near = math.nan
        for index, (pose, twist) in enumerate(zip(poses, commands.twists, strict=True)):
            stamp = int(commands.stamps[index])
            settings = settings_of[index]
            period = settings.control_period
            if index + 1 < len(commands.stamps):
                held = (int(commands.stamps[index + 1]) - stamp) / NANOSECONDS
                period = min(max(held, 0.0), period)
            near = project_on_path(settings.road, pose, near)
            spare = _spare(settings, pose, twist, period, near)
            if spare.min() < worst:
                worst, at = float(spare.min()), stamp
                column = int(spare.argmin())
                names = settings.road.edge_names
                nearest = (*names, *(f'obstacle {o.name}' for o in settings.obstacles))[column]
    if worst == math.inf:
        return skipped('No command is finite.')
    passed = worst >= -_ROUNDING
    sentence = (
        f'No command leads off the road or into an obstacle; nearest is {nearest}.'
        if passed
        else f'A command leads {-worst:.3g} m too close to {nearest} before the next is due.'
    )
    return passed_if(passed, sentence, worst=worst, limit=0.0, unit='m', at=record.seconds(at))


def _effect_delay(settings: GuidanceSettings, decision: DecisionRecord | None) -> float:
    """Delay from a command to its effect, as it was estimated when the command was decided [s]."""
    if decision is None:
        return settings.command_delay
    if decision.response_delay is not None:
        return decision.response_delay
    return settings.command_delay + decision.wheel_lag


def jumps(record: AuditRecord) -> Verdict:
    """Whether the motion in the odometry is feasible for the robot."""
    settings = record.history.epochs[0].settings
    robot, max_jump = settings.robot, settings.safety.max_odom_jump
    if not math.isfinite(robot.max_wheel_speed):
        return skipped('The wheels have no limit (robot.max_wheel_speed is 0).')
    if not max_jump:
        return skipped('Any jump is allowed (safety.max_odom_jump is 0).')
    worst: tuple[float, float, float, str, int] = (-math.inf, 0.0, 0.0, '', record.start)
    for leg in record.legs:
        odometry = leg.odometry
        durations = np.diff(odometry.stamps) / NANOSECONDS
        moved = np.column_stack(
            [
                np.hypot(*np.diff(odometry.poses[:, :2], axis=0).T),
                np.abs(wrapped(np.diff(odometry.poses[:, 2]))),
            ]
        )
        # Of two at one instant the later counts, as when the robot is put somewhere else.
        allowed = np.column_stack(motion_limits(robot, durations, max_jump))
        excess = np.where(durations[:, None] > 0.0, moved / allowed - 1.0, -np.inf)
        row, column = np.unravel_index(int(excess.argmax()), excess.shape)
        found = float(moved[row, column]), float(allowed[row, column])
        stamp = int(odometry.stamps[row])
        worst = max(worst, (float(excess[row, column]), *found, ('m', 'rad')[column], stamp))
    excess_of_worst, value, limit, unit, stamp = worst
    passed = excess_of_worst <= 0.0
    sentence = (
        'Odometry shows no more than the robot can drive.'
        if passed
        else f'Between two samples odometry jumps by {value:.3g} {unit}, more than can be driven.'
    )
    return passed_if(
        passed, sentence, worst=value, limit=limit, unit=unit, at=record.seconds(stamp)
    )


def goal(record: AuditRecord) -> Verdict:
    """Miss at each goal at its time, in each run that was not begun again before."""
    if record.history.epochs[0].settings.follow is not None:
        return skipped('There is no goal: a road is followed (follow.speed).')
    passings = []
    remaining = math.inf
    for leg in record.legs:
        for run in leg.runs:
            for place in _goals_of(record, run):
                stamp = run.start + to_nanoseconds(place.time)
                remaining = min(remaining, (stamp - run.end) / NANOSECONDS)
                if stamp <= run.end:
                    settings, pose = record.history.at(stamp), leg.path.at(stamp)
                    passings.append((Passing.of(settings, place, stamp, pose), settings))
    if not passings:
        return skipped(f'The recording ends {remaining:.3g} s before the final time.')
    worst, settings = max(passings, key=lambda each: each[0].ratio)
    name = worst.goal.name
    when = f'At {worst.goal.time:g} s' if name not in ('', GOAL) else 'At the final time'
    count = f' It is the worst of {len(passings)} goals.' if len(passings) > 1 else ''
    passed = worst.ratio <= 1.0
    sentence = (
        f'{when} the robot is {worst}{"." if passed else ", which is beyond its tolerance."}{count}'
    )
    return passed_if(
        passed,
        sentence,
        worst=worst.miss,
        limit=settings.goal_tolerance,
        unit='m',
        at=record.seconds(worst.stamp),
    )


def _clear(record: AuditRecord, columns: slice, wanted: float) -> Verdict:
    worst, at, nearest, radius = math.inf, record.start, '', 0.0
    for each in record.sweeps:
        part = each.clearance[:, columns]
        if part.size and part.min() < worst:
            row, column = np.unravel_index(int(part.argmin()), part.shape)
            worst, at = float(part[row, column]), int(each.stamps[row])
            nearest = each.name(int(column) + (columns.start or 0))
            has_corners = each.settings.footprint.corners
            radius = 0.0 if has_corners else each.settings.robot_radius
    passed = worst >= wanted - _ROUNDING
    around = f'the robot (radius {radius:.3g} m)' if radius else 'the robot'
    sentence = (
        f'Between samples too, {around} keeps {worst:.3g} m from {nearest}.'
        if worst >= 0.0
        else f'Along the path driven, {around} cuts {nearest} by {-worst:.3g} m.'
    )
    return passed_if(passed, sentence, worst=worst, limit=wanted, unit='m', at=record.seconds(at))


def _measured(leg: Leg, stamps: NDArray[np.int64], delays: Array) -> Array:
    """The latest poses measured when commands take effect, shape ``(M, 3)``.

    Args:
        leg: With the odometry.
        stamps: Of the commands ``(M,)`` [ns].
        delays: Time from each to its effect ``(M,)`` [s].
    """
    effects = stamps + np.round(np.multiply(delays, NANOSECONDS)).astype(np.int64)
    index = np.searchsorted(leg.odometry.stamps, effects, side='right') - 1
    poses = leg.odometry.poses[np.maximum(index, 0)]
    # Between two messages the robot has moved on, and nothing was decided there.
    late = effects > stamps
    poses[late] = interpolated(leg.odometry, effects[late])
    return poses


def _spare(
    settings: GuidanceSettings, pose: Array, twist: Array, period: float, near: float
) -> Array:
    """Clearance of an arc above the clearance required, ``(2 + M,)`` [m]."""
    space = settings.space()
    start, held = pose[None], np.array([period])
    floor = np.minimum(space.at(start, near)[0], 0.0)
    if settings.safety.between_samples:
        spare: Array = space.along(start, twist[None], held, near)[0] - floor
    else:
        end = arc_ends(start, twist[None], held)
        spare = space.at(end, near)[0] - (floor - _SAMPLE_TOLERANCE)
    return spare


def _goals_of(record: AuditRecord, run: RunSpan) -> list[Goal]:
    """The goals of a run that were in force at their times, in order.

    The first goal on `goal_pose` replaces those of the parameters; a later one replaces those
    before whose time has not come. So does one that is put off.
    """
    is_put_off = record.history.at(run.start).may_be_late
    received = [each for each in record.decisions if run.start <= each.stamp <= run.end]
    received = [
        each for each in received if each.goal is not None and (each.goals_received or is_put_off)
    ]
    until = float('inf') if not received else (received[0].stamp - run.start) / NANOSECONDS
    goals = []
    for index, goal in enumerate(record.history.at(run.start).goals):
        then = record.history.at(run.start + round(goal.time * NANOSECONDS)).goals
        if goal.time <= until:
            goals.append(replace(then[index], time=goal.time))
    for each, after in zip_longest(received, received[1:]):
        assert each.goal is not None  # noqa: S101 (looked at above)
        if after is None or after.goal != each.goal:
            end = float('inf') if after is None else (after.stamp - run.start) / NANOSECONDS
            if each.goal.time <= end:
                goals.append(each.goal)
    return goals
