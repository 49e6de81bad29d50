"""Checks of the path: was it clear, feasible for the wheels, and did it end at the goal?"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import zip_longest
from typing import Any

import numpy as np

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.bags.audit.clearance import EDGES, NOTHING_NEAR, OUT_OF_REACH, Sweep
from cmpsp_ros.bags.audit.finding import (
    CheckOutcome,
    Verdict,
    not_judged,
    passed_if,
    skipped,
    unless,
)
from cmpsp_ros.bags.audit.legs import Leg, RunSpan
from cmpsp_ros.bags.audit.record import AuditRecord
from cmpsp_ros.bags.decision_record import DecisionRecord
from cmpsp_ros.bags.runs.encounters import Encounter
from cmpsp_ros.bags.runs.goals import Passing
from cmpsp_ros.bags.runs.odometry import interpolated, is_within, wrapped
from cmpsp_ros.bags.runs.seen import EXACT
from cmpsp_ros.guidance import GOAL, NANOSECONDS, Goal, GuidanceSettings, to_nanoseconds
from cmpsp_ros.guidance.messages import motion_limits
from cmpsp_ros.robots import arc_ends
from cmpsp_ros.world.roads import project_on_path

_ROUNDING = 1e-6
"""What rounding may take from a clearance [m]."""

_SAMPLE_TOLERANCE = 1e-3
"""What a linearised constraint may be short of at a sample [m]; see `guidance.audit`."""


_NO_OBSTACLE = 'There is no obstacle among the parameters.'
_TOO_CLOSE = f'That is within what sensors may be off by ({EXACT} m).'


def road(record: AuditRecord) -> Verdict:
    """Clearance from both road edges."""
    if not any(each.settings.road.has_center_line for each in record.sweeps):
        return skipped('There is no road (road.type is none).')
    return unless(_clear(record, slice(0, EDGES), 0.0), record.hole_sentence)


def obstacles(record: AuditRecord) -> Verdict:
    """Clearance from all obstacles: of parameters and simulator, and from what sensors saw."""
    known = any(each.settings.obstacles for each in record.evidence)
    if not known and not any(record.seen):
        return not_judged(unseen) if (unseen := record.unseen) else skipped(_NO_OBSTACLE)
    verdict = _clear(record, slice(EDGES, None), 0.0)
    if verdict.worst is not None and verdict.worst < -_ROUNDING:
        touched = verdict.outcome is CheckOutcome.PASSED and not record.history.simulated
        verdict = unless(verdict, _TOO_CLOSE if touched else '')
    return unless(unless(verdict, record.unseen), record.hole_sentence)


def moving(record: AuditRecord) -> Verdict:
    """Clearance from moving obstacles at their predicted positions, while the robot moved.

    A collision with a robot at rest is not its own.
    """
    met = record.encounters
    if not met:
        known = (key for each in record.decisions for key, _ in each.tracks)
        were_there = any(isinstance(key, int) for key in known)
        if were_there or record.history.has_traffic:
            return not_judged(f'The bag lacks the moving obstacles in {record.places.moving}.')
        return skipped(f'No moving obstacle is in {record.places.moving}.')
    return unless(_apart(record, met, ', at its predicted position'), record.hole_sentence)


def others(record: AuditRecord) -> Verdict:
    """Clearance from the other robots at their positions, while the robot moved.

    A collision with a robot at rest is not its own.
    """
    named = record.history.epochs[0].settings.moving_obstacles.others
    if not named:
        return skipped('No other robots are to be kept clear of (others.namespaces).')
    missing = record.others_sentence
    if not record.robot_encounters:
        return not_judged(missing or 'The bag has no path of others at the time of this one.')
    verdict = _apart(record, record.robot_encounters, '')
    return unless(unless(verdict, missing), record.hole_sentence)


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
    verdict = unless(_clear(record, slice(None), wanted), record.unseen)
    return unless(verdict, record.hole_sentence)


def commanded(record: AuditRecord) -> Verdict:
    """The arc of each command, held for a control period from the pose where it takes effect.

    That is the pose of its odometry, or with `command_delay`, or with a delay or lag that was
    estimated, the one measured that much later. A robot that is too close already may only be
    commanded not to get closer.
    """
    worst, at, nearest = math.inf, record.start, ''
    estimates = {each.stamp: each for each in record.decisions}
    unknown = 0
    for leg, seeing in zip(record.legs, record.knowledge(), strict=True):
        commands = leg.commands.chosen(np.all(np.isfinite(leg.commands.twists), axis=1))
        settings_of = [record.history.at(int(stamp)) for stamp in commands.stamps]
        answered = [estimates.get(stamp) for stamp in commands.stamps.tolist()]
        delays = np.array(list(map(_effect_delay, settings_of, answered)))
        poses = _measured(leg, commands.stamps, delays)
        near = math.nan
        for index, (pose, twist) in enumerate(zip(poses, commands.twists, strict=True)):
            stamp = int(commands.stamps[index])
            if is_within(stamp, leg.by_odometry.holes):
                unknown += bool(twist.any())
                continue
            epoch = record.history.epoch_at(stamp)
            settings = seeing(epoch.course, stamp)
            period = settings.control_period
            if index + 1 < len(commands.stamps):
                held = (int(commands.stamps[index + 1]) - stamp) / NANOSECONDS
                period = min(max(held, 0.0), period)
            near = project_on_path(settings.road, pose, near)
            spare = _spare(settings, pose, twist, period, near)
            spare[EDGES:][epoch.of_hidden] += leg.by_odometry.off
            if spare.min() < worst:
                worst, at = float(spare.min()), stamp
                column = int(spare.argmin())
                names = settings.road.edge_names
                nearest = (*names, *(f'obstacle {o.name}' for o in settings.obstacles))[column]
    missing = f'{unknown} commands have no pose in the bag.' if unknown else ''
    if worst == math.inf:
        return not_judged(missing) if missing else skipped('No command is finite.')
    figures: dict[str, Any] = {'worst': worst, 'limit': 0.0, 'unit': 'm', 'at': record.seconds(at)}
    if worst >= OUT_OF_REACH:
        sentence, figures = NOTHING_NEAR, {}
    elif worst >= -_ROUNDING:
        sentence = f'No command leads off the road or into an obstacle; nearest is {nearest}.'
    else:
        sentence = f'A command leads {-worst:.3g} m too close to {nearest} before the next is due.'
    verdict = passed_if(worst >= -_ROUNDING, sentence, **figures)
    return unless(unless(verdict, missing), record.unseen)


def _effect_delay(settings: GuidanceSettings, decision: DecisionRecord | None) -> float:
    """Delay from a command to its effect, as it was estimated when the command was decided [s]."""
    if decision is not None and decision.response_delay is not None:
        return float(decision.response_delay[0])
    lag = None if decision is None else decision.wheel_lag
    return settings.command_delay + (0.0 if lag is None else float(lag[0]))


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
    passings, missing = [], ''
    for leg in record.legs:
        for run in leg.runs:
            for place in _goals_of(record, run):
                stamp = run.start + to_nanoseconds(place.time)
                settings = record.history.at(stamp)
                poses = [pose for each in leg.known if (pose := each.at(stamp)) is not None]
                found = (Passing.of(settings, place, stamp, pose) for pose in poses)
                passings += [(each, settings) for each in found]
                if stamp > run.end and run is record.legs[-1].runs[-1]:
                    early = (stamp - run.end) / NANOSECONDS
                    missing = f'The recording ends {early:.3g} s before the final time.'
                elif stamp <= run.end and not poses:
                    missing = f'No pose is recorded at {place.time:g} s, the time of a goal.'
    if not passings:
        return not_judged(missing or 'No run lasts until the time of its goal.')
    worst, settings = max(passings, key=lambda each: each[0].ratio)
    name = worst.goal.name
    when = f'At {worst.goal.time:g} s' if name not in ('', GOAL) else 'At the final time'
    goals = len({each.stamp for each, _ in passings})
    count = f' It is the worst of {goals} goals.' if goals > 1 else ''
    passed = worst.ratio <= 1.0
    sentence = (
        f'{when} the robot is {worst}{"." if passed else ", which is beyond its tolerance."}{count}'
    )
    verdict = passed_if(
        passed,
        sentence,
        worst=worst.miss,
        limit=settings.goal_tolerance,
        unit='m',
        at=record.seconds(worst.stamp),
    )
    return unless(verdict, missing)


def _clear(record: AuditRecord, columns: slice, wanted: float) -> Verdict:
    """The least clearance by any evidence; what is proven by one is not undone by another."""
    worst: tuple[bool, float, int, str, Sweep | None] = (False, -math.inf, record.start, '', None)
    for each in record.evidence:
        part = np.nan_to_num(each.clearance[:, columns], nan=-math.inf)
        if part.size:
            row, column = np.unravel_index(int(part.argmin()), part.shape)
            short = wanted - float(part[row, column])
            name = each.names[int(column) + (columns.start or 0)]
            is_proven = short > _ROUNDING + each.tolerance
            found = is_proven, short, int(each.stamps[row]), name, each
            worst = max(worst, found, key=lambda one: one[:2])
    failed, short, at, nearest, source = worst
    least = wanted - short
    if source is None or least >= OUT_OF_REACH:
        return passed_if(True, NOTHING_NEAR)
    radius = 0.0 if source.settings.footprint.corners else source.settings.robot_radius
    around = f'the robot (radius {radius:.3g} m)' if radius else 'the robot'
    by = f' (by {source.by})' if source.by else ''
    sentence = (
        f'Between samples too, {around} keeps {least:.3g} m from {nearest}{by}.'
        if least >= 0.0
        else f'Along the path driven, {around} cuts {nearest} by {-least:.3g} m{by}.'
    )
    figures = {'worst': least, 'limit': wanted, 'unit': 'm', 'at': record.seconds(at)}
    return passed_if(not failed, sentence, **figures)


def _measured(leg: Leg, stamps: IntArray, delays: Array) -> Array:
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
    space = settings.world.free_space(settings)
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
