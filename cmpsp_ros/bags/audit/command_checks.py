"""Checks of motion: odometry without jumps, commands within limits, as decided and obeyed."""

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray, IntArray
from cmpsp_ros.bags.audit.finding import Sample, SkippedError, check
from cmpsp_ros.bags.audit.legs import Leg, agreeing
from cmpsp_ros.bags.audit.record import AuditRecord, path_gap
from cmpsp_ros.bags.decision_record import wheel_speeds
from cmpsp_ros.bags.runs import overlaps
from cmpsp_ros.bags.runs.odometry import mean_twists, wrapped
from cmpsp_ros.guidance import NANOSECONDS, GuidanceSettings
from cmpsp_ros.guidance.messages import motion_limits
from cmpsp_ros.guidance.safety import CHANGE_ROUNDING

# Part of a wheel speed or steering angle that is lost on the way to a twist and back.
_ROUNDING: Final = 1e-9
LATE: Final = 1.5  # control periods after which the next command is missing
# Part of the time for which a command holds after which the robot has to obey it.
_SETTLED: Final = 2.0 / 3.0
# Control periods for which a command has to hold before obedience can be judged.
_BRIEF: Final = 0.5
_OBEYED: Final = 0.1  # part of the largest wheel speed by which a wheel may differ from its command
_LAGS: Final = 3.0  # time constants of the wheels after which they have followed a stop
_UNSTEERED: Final = (math.inf, math.inf)
_SIGMAS: Final = 3.0 * math.sqrt(2.0)

WHEELS: Final = ('robot.wheel_radius', 'robot.half_track', 'robot.max_wheel_speed')


@check(
    'jumps', 'Odometry: no jumps', needs=WHEELS,
    good='Odometry shows no more than the robot can drive.',
    bad='Between two samples odometry jumps by {worst:.3g} {unit}, more than can be driven.',
)  # fmt: skip
def jumps(record: AuditRecord) -> Iterator[Sample]:
    """Motion from each odometry sample to the next."""
    reasons = [_why_any_jump(each.settings) for each in record.history.epochs]
    if all(reasons):
        raise SkippedError(reasons[0])
    for leg in record.legs:
        stamps, poses = leg.odometry.stamps, leg.odometry.poses
        durations = np.diff(stamps) / NANOSECONDS
        steps = np.diff(poses, axis=0)
        ways = np.hypot(*steps[:, :2].T), np.abs(wrapped(steps[:, 2]))
        for epoch, at in leg.history.periods(stamps[:-1]):
            robot, max_jump = epoch.settings.robot, epoch.settings.safety.max_odom_jump
            if _why_any_jump(epoch.settings):
                continue
            limits = motion_limits(robot, durations[at], max_jump)
            for unit, way, allowed in zip(('m', 'rad'), ways, limits, strict=True):
                # Of two at one instant the later counts, as when the robot is put somewhere else.
                excess = np.where(durations[at] > 0.0, way[at] / allowed - 1.0, -np.inf)
                found = Sample.largest(way[at], allowed, stamps[at], excess)
                yield replace(found, unit=unit, words={'unit': unit})


def _why_any_jump(settings: GuidanceSettings) -> str:
    if not math.isfinite(settings.robot.max_wheel_speed):
        return 'The wheels have no limit (robot.max_wheel_speed is 0).'
    return (
        '' if settings.safety.max_odom_jump else 'Any jump is allowed (safety.max_odom_jump is 0).'
    )


@check(
    'finite', 'Commands: finite', good='All {total} commands are finite.',
    bad='{worst:.0f} of {total} commands are not finite.',
)  # fmt: skip
def finite(record: AuditRecord) -> Iterator[Sample]:
    """Number of commands that are not finite."""
    wrong = ~np.all(np.isfinite(record.commands.twists), axis=1)
    first = int(record.commands.stamps[wrong.argmax()])
    yield Sample.count(int(wrong.sum()), first, total=len(wrong))


@check(
    'wheel_limits', 'Commands: wheel limits', needs=WHEELS, unit='rad/s',
    good='Every command is within what the wheels can do.',
    bad='A command asks {worst:.4g} rad/s of a wheel.',
)  # fmt: skip
def wheel_limits(record: AuditRecord) -> Iterator[Sample]:
    """Wheel speed of each finite command."""
    limits = record.of_commands(lambda each: each.robot.max_wheel_speed)
    if not np.isfinite(limits).any():
        raise SkippedError('The wheels have no limit (robot.max_wheel_speed is 0).')
    yield Sample(-1.0, float(limits.min()), record.start, -math.inf)
    commands = record.commands
    known = zip(commands.received, commands.stamps, commands.twists, limits.tolist(), strict=True)
    for received, stamp, twist, limit in known:
        robot = record.history.received_by(int(received)).settings.robot
        speed = float(np.abs(robot.wheel_speeds(twist)).max())
        if math.isfinite(limit) and not math.isnan(speed):
            yield Sample(speed, limit, int(stamp), speed / limit - (1.0 + _ROUNDING))


@check(
    'acceleration', 'Commands: acceleration', needs=(*WHEELS[:2], 'control_period'), unit='rad/s',
    good='The wheels can follow from each command to the next.',
    bad='A wheel is to change by {worst:.4g} rad/s from one command to the next.',
)  # fmt: skip
def acceleration(record: AuditRecord) -> Iterator[Sample]:
    """Change of the wheel speeds from each command to the next, and from rest; halts are exempt."""
    limits = record.of_commands(lambda each: each.max_wheel_change)
    if not np.isfinite(limits).any():
        raise SkippedError('The wheels have no such limit (robot.max_wheel_acceleration is 0).')
    wheels = _changing(record)
    changes = np.abs(np.diff(wheels, axis=0, prepend=0.0 * wheels[:1])).max(axis=1)
    changes[_unplanned(record)] = 0.0
    yield _largest(record, changes, limits, changes - limits - CHANGE_ROUNDING)


@check(
    'jerk', 'Commands: jerk', needs=(*WHEELS[:2], 'control_period'), of_decisions=True,
    unit='rad/s', good='The acceleration of no wheel changes faster than it may.',
    bad='The change of a wheel is to change by {worst:.4g} rad/s from one command to the next.',
)  # fmt: skip
def jerk(record: AuditRecord) -> Iterator[Sample]:
    """Second difference of the wheel speeds of each command of a plan, but after gaps."""
    limits = record.of_commands(lambda each: each.max_second_difference)
    if not np.isfinite(limits).any():
        raise SkippedError('The wheels have no such limit (robot.max_wheel_jerk is 0).')
    pairs = record.pairs
    wheels = record.settings.robot.wheel_speeds(record.commands.twists)
    changes = np.diff(wheels, axis=0, prepend=0.0 * wheels[:1])
    answered = record.decisions[pairs.decisions]
    stops = np.ones(len(wheels), dtype=bool)
    stops[pairs.commands] = [each.level == 'stop' for each in answered]
    gaps = _unplanned(record) & ~stops
    before = np.where(stops[:-1, None], 0.0, changes[:-1])
    found = np.abs(changes - np.vstack([0.0 * wheels[:1], before])).max(axis=1)
    found[stops | gaps | np.append(False, gaps[:-1])] = 0.0
    yield _largest(record, found, limits, found - limits - CHANGE_ROUNDING)


@check(
    'lateral_acceleration', 'Commands: lateral acceleration', unit='m/s^2',
    good='No command turns faster than its speed allows.',
    bad='A command asks for a lateral acceleration of {worst:.4g} m/s^2.',
)  # fmt: skip
def lateral_acceleration(record: AuditRecord) -> Iterator[Sample]:
    """Speed of each finite command, in any direction, times its turn rate."""
    limits = record.of_commands(lambda each: each.robot.max_lateral_acceleration)
    if not np.isfinite(limits).any():
        raise SkippedError('There is no such limit (robot.max_lateral_acceleration is 0).')
    *speeds, turn_rates = record.commands.twists.T
    found = np.nan_to_num(np.abs(np.hypot(speeds[0], speeds[-1] * (len(speeds) > 1)) * turn_rates))
    yield _largest(record, found, limits, found / limits - (1.0 + _ROUNDING))


@check(
    'steering', 'Commands: steering', needs=('control_period',), unit='rad',
    good='The steering can follow each command.',
    bad='The steering angle is to be {angle:.4g} rad, {changed:.4g} rad from the one before.',
)  # fmt: skip
def steering(record: AuditRecord) -> Iterator[Sample]:
    """Steering angle of a car and its change, from straight ahead at first.

    A command at rest says nothing of the steering: it is as decided, or else as before.
    """
    if record.settings.robot.steering_limits is None:
        raise SkippedError('The robot is not steered (robot.model).')
    top, rates = record.of_commands(lambda each: each.robot.steering_limits or _UNSTEERED).T
    angles = _steering_angles(record)
    changes = np.abs(np.diff(angles, prepend=0.0))
    changes[_unplanned(record)] = 0.0
    most = rates * record.of_commands(lambda each: each.control_period)
    index = int(np.maximum(np.abs(angles) / top, changes / most).argmax())
    angle, changed = float(np.abs(angles[index])), float(changes[index])
    excess = max(angle - top[index] * (1.0 + _ROUNDING), changed - most[index] - CHANGE_ROUNDING)
    words = {'angle': angle, 'changed': changed}
    at, largest = int(record.commands.stamps[index]), float(np.abs(angles).max())
    yield Sample(largest, float(top[index]), at, excess, words=words)


def _undecided(record: AuditRecord, worst: Sample) -> str:
    alone = record.commands.moving.copy()
    alone[record.pairs.commands] = False
    is_gap = worst.passes and alone.any()
    return f'{alone.sum()} others have no decision in the bag.' if is_gap else ''


@check(
    'as_decided', 'Commands: as decided', needs=WHEELS[:2], of_decisions=True,
    good='All {total} commands are what was decided.',
    bad='{worst:.0f} of {total} commands are not what was decided; the first is {sent} instead of '
    '{wanted}.',
    gaps=(_undecided,),
)  # fmt: skip
def as_decided(record: AuditRecord) -> Iterator[Sample]:
    """Number of commands that differ from those decided."""
    decided = record.settings.robot.twist_of_wheels(wheel_speeds(record.decisions))
    pairs = record.pairs
    wrong = ~agreeing(record.commands, decided, pairs)
    if not wrong.any():
        yield Sample.count(0, None, total=pairs.count)
        return
    first = int(wrong.argmax())
    sent, wanted = record.commands.twists[pairs.commands][first], decided[pairs.decisions][first]
    at = int(record.commands.stamps[pairs.commands][first])
    words = {'total': pairs.count, 'sent': _in_words(sent), 'wanted': _in_words(wanted)}
    yield Sample.count(int(wrong.sum()), at, **words)


def _vague(record: AuditRecord, _worst: Sample) -> str:
    is_vague = any((allowed >= limit).all() for limit, *_, allowed in _followed(record))
    said = 'By its covariance odometry may be off by as much as the wheels can turn.'
    return said if is_vague else ''


@check(
    'obeyed', 'Commands: obeyed', needs=(*WHEELS, 'control_period'), unit='rad/s',
    good='The robot drives what is commanded.',
    bad='A wheel turns {worst:.3g} rad/s slower or faster than commanded.',
    nothing='No command was held for long enough.', gaps=(_vague, path_gap),
)  # fmt: skip
def obeyed(record: AuditRecord) -> Iterator[Sample]:
    """Difference of wheel speeds from each command, after the time that the robot needs."""
    epochs = record.history.epochs
    if not any(math.isfinite(each.settings.robot.max_wheel_speed) for each in epochs):
        raise SkippedError('The wheels have no limit (robot.max_wheel_speed is 0) to measure by.')
    for _, begins, off, allowed in _followed(record):
        yield Sample.largest(off, allowed, begins, off / allowed - 1.0)


def _followed(record: AuditRecord) -> Iterator[tuple[float, IntArray, Array, Array]]:
    """Commands held, by the parameters in force, where wheels have a largest speed [rad/s].

    They are that speed, their begins [ns], and wheel errors with their limits [rad/s].
    """
    epochs = ((leg, *each) for leg in record.legs for each in enumerate(leg.history.epochs))
    for leg, place, epoch in epochs:
        robot = epoch.settings.robot
        if not math.isfinite(robot.max_wheel_speed):
            continue
        held = _held(leg, epoch.settings)
        begins, ends, twists = (each[leg.history.index(held[0]) == place] for each in held)
        known = [
            not overlaps(span, leg.by_odometry.holes) for span in zip(begins, ends, strict=True)
        ]
        begins, ends, twists = begins[known], ends[known], twists[known]
        if not len(begins):
            continue
        duration = (ends - begins) / NANOSECONDS
        off = robot.wheel_differences(mean_twists(leg.odometry, begins, ends), twists)
        spread = leg.odometry.spreads.max(axis=0)
        noise = _SIGMAS * (spread[0] + robot.half_track * spread[1]) / duration
        allowed = _OBEYED * robot.max_wheel_speed + noise / robot.wheel_radius
        yield robot.max_wheel_speed, begins, off, allowed


def _held(leg: Leg, settings: GuidanceSettings) -> tuple[IntArray, IntArray, Array]:
    stamps, delay = leg.commands.stamps, round(settings.command_delay * NANOSECONDS)
    standing = _standing(leg, settings)
    begins = np.append(stamps[:-1], standing[:-1]) + delay
    ends = np.append(stamps[1:], standing[1:]) + delay
    # The last command counts once it has stopped the robot.
    twists = np.vstack([leg.commands.twists[:-1], *[leg.commands.twists[-1:]] * len(standing[1:])])
    durations = ends - begins
    periods = durations / (settings.control_period * NANOSECONDS)
    chosen = (periods >= _BRIEF) & (periods <= LATE)
    chosen &= (begins >= leg.path.stamps[0]) & (ends <= leg.path.stamps[-1])
    chosen &= np.isfinite(twists).all(axis=1)
    settled = begins + np.round(_SETTLED * durations).astype(np.int64)
    return settled[chosen], ends[chosen], twists[chosen]


def _standing(leg: Leg, settings: GuidanceSettings) -> IntArray:
    """Control periods at rest after a last command that is a stop, as instants [ns]."""
    odometry, last = leg.odometry.stamps, int(leg.commands.stamps[-1])
    robot, period = settings.robot, settings.control_period
    braking = robot.max_wheel_speed / robot.max_wheel_acceleration
    until_rest = period + settings.safety.stopping_time + _LAGS * settings.max_lag + braking
    # Of two at one instant the later counts: the robot was set somewhere else.
    is_set = (np.diff(odometry) == 0) & np.diff(leg.odometry.poses, axis=0).any(axis=1)
    moved = odometry[1:][is_set & (odometry[1:] > last)]
    end = next(iter(moved), odometry[-1]) if not leg.commands.moving[-1] else last
    begin = last + round(until_rest * NANOSECONDS)
    return np.arange(begin, end, round(period * NANOSECONDS), dtype=np.int64)


def _largest(record: AuditRecord, values: Array, limits: Array, excess: Array) -> Sample:
    """The worst command of those that have a limit; arguments of shape ``(C,)``."""
    excess = np.where(np.isfinite(limits), excess, -np.inf)
    return Sample.largest(values, limits, record.commands.stamps, excess)


def _changing(record: AuditRecord) -> Array:
    """Quantities of each command whose change is limited, shape ``(C, q)`` [rad/s].

    At rest, when a twist says nothing of angles, it is as decided.
    """
    robot, pairs = record.settings.robot, record.pairs
    wheels = robot.wheel_speeds(record.commands.twists)
    decided = wheel_speeds(record.decisions[pairs.decisions])
    at_rest = ~record.commands.moving[pairs.commands]
    wheels[pairs.commands][at_rest] = decided[at_rest, : wheels.shape[1]]
    return robot.rates(wheels)


def _steering_angles(record: AuditRecord) -> Array:
    """Steering angle of each command, shape ``(C,)`` [rad]."""
    robot = record.settings.robot
    said = [robot.steering_of(each) or 0.0 for each in robot.controls(record.commands.twists)]
    known = record.commands.twists[:, 0] != 0.0
    pairs = record.pairs
    answered = record.decisions[pairs.decisions]
    for index, each in enumerate(answered, pairs.commands.start):
        if each.steering_angle is not None and not known[index]:
            said[index], known[index] = each.steering_angle, True
    for index in np.flatnonzero(~known).tolist():
        said[index] = said[index - 1] if index else 0.0
    return np.array(said)


def _unplanned(record: AuditRecord) -> BoolArray:
    """Commands without a known predecessor: halts, and the first after a gap."""
    if not record.decisions:
        unplanned = ~record.commands.moving
        unplanned[0] = True
        return unplanned
    unplanned = np.zeros(len(record.commands.stamps), dtype=bool)
    pairs, decisions = record.pairs, record.decisions
    first, answered = pairs.commands.start, decisions[pairs.decisions]
    unplanned[: first + 1] = answered[0].step > 0
    for index, (before, after) in enumerate(pairwise(answered), first + 1):
        is_next = after.run == before.run and after.step <= before.step + 1
        unplanned[index] = after.halted or not is_next
    return unplanned


def _in_words(twist: Array) -> str:
    *speeds, turn_rate = twist
    return ', '.join([*(f'{each:.4g} m/s' for each in speeds), f'{turn_rate:.4g} rad/s'])
