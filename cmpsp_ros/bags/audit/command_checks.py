"""Checks of the commands: were they feasible, in time, and obeyed?"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.bags.audit.commands import agreeing
from cmpsp_ros.bags.audit.finding import Verdict, not_judged, passed_if, skipped, unless
from cmpsp_ros.bags.audit.legs import Leg
from cmpsp_ros.bags.audit.record import AuditRecord
from cmpsp_ros.bags.decision_record import wheel_speeds
from cmpsp_ros.bags.runs.odometry import Hole, in_words, mean_twists, overlaps
from cmpsp_ros.guidance import NANOSECONDS, GuidanceSettings, to_nanoseconds

_ROUNDING = 1e-9
"""Part of a wheel speed that is lost on the way to a twist and back."""

LATE: Final = 1.5
"""Control periods after which the next command is missing."""

_SLACK = 0.15
"""What may lie between a node's clock and its timers, and a recorder's [s]."""

_SAME_CLOCK = 10.0
"""Difference from which times of reception are taken for those of another clock [s]."""

_SETTLED = 2.0 / 3.0
"""Part of the time for which a command holds after which the robot has to obey it."""

_BRIEF = 0.5
"""Control periods for which a command has to hold before obedience can be judged."""

_OBEYED = 0.1
"""Part of the largest wheel speed by which a wheel may differ from its command."""

_SIGMAS = 3.0 * math.sqrt(2.0)


def finite(record: AuditRecord) -> Verdict:
    """Whether every command is a number."""
    wrong = ~np.all(np.isfinite(record.commands.twists), axis=1)
    count = int(wrong.sum())
    at = record.seconds(int(record.commands.stamps[wrong.argmax()])) if count else None
    sentence = (
        f'{count} of {len(wrong)} commands are not finite.'
        if count
        else f'All {len(wrong)} commands are finite.'
    )
    return passed_if(not count, sentence, worst=float(count), limit=0.0, at=at)


def wheel_limits(record: AuditRecord) -> Verdict:
    """Whether the wheels can turn as fast as commanded."""
    robot = record.history.epochs[0].settings.robot
    if not math.isfinite(robot.max_wheel_speed):
        return skipped('The wheels have no limit (robot.max_wheel_speed is 0).')
    worst, limit, at = -1.0, robot.max_wheel_speed, record.start
    for stamp, twist in zip(record.commands.stamps, record.commands.twists, strict=True):
        robot = record.history.at(int(stamp)).robot
        speed = float(np.abs(robot.wheel_speeds(twist)).max())
        if speed / robot.max_wheel_speed > worst / limit:
            worst, limit, at = speed, robot.max_wheel_speed, int(stamp)
    passed = worst <= limit * (1.0 + _ROUNDING)
    sentence = (
        'Every command is within what the wheels can do.'
        if passed
        else f'A command asks {worst:.4g} rad/s of a wheel.'
    )
    return passed_if(
        passed, sentence, worst=worst, limit=limit, unit='rad/s', at=record.seconds(at)
    )


def as_decided(record: AuditRecord) -> Verdict:
    """Whether the commands sent are those decided."""
    robot = record.history.epochs[0].settings.robot
    decided = robot.twist_of_wheels(wheel_speeds(record.decisions))
    pairs = record.pairs
    wrong = ~agreeing(record.commands, decided, pairs)
    count = int(wrong.sum())
    if not count:
        alone = record.commands.moving.copy()
        alone[pairs.commands :][: pairs.count] = False
        missing = f'{alone.sum()} others have no decision in the bag.' if alone.any() else ''
        sentence = f'All {pairs.count} commands are what was decided.'
        return unless(passed_if(True, sentence, worst=0.0, limit=0.0), missing)
    where = int(wrong.argmax())
    sent, wanted = record.commands.twists[pairs.commands + where], decided[pairs.decisions + where]
    return passed_if(
        False,
        f'{count} of {pairs.count} commands are not what was decided; the first is'
        f' {_in_words(sent)} instead of {_in_words(wanted)}.',
        worst=float(count),
        limit=0.0,
        at=record.seconds(int(record.commands.stamps[pairs.commands + where])),
    )


def obeyed(record: AuditRecord) -> Verdict:
    """Whether the robot obeys its commands, after the time that it needs to."""
    robot = record.history.epochs[0].settings.robot
    if not math.isfinite(robot.max_wheel_speed):
        return skipped('The wheels have no limit (robot.max_wheel_speed is 0) to measure by.')
    settings = record.history.epochs[0].settings
    worst, limit, at, ratio = 0.0, _OBEYED * robot.max_wheel_speed, record.start, -1.0
    for leg in record.legs:
        begins, ends, twists = _held(leg, settings)
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
        index = int((off / allowed).argmax())
        if off[index] / allowed[index] > ratio:
            ratio = float(off[index] / allowed[index])
            worst, limit, at = float(off[index]), float(allowed[index]), int(begins[index])
    missing = record.hole_sentence
    if ratio < 0.0:
        reason = 'No command was held for long enough.'
        return not_judged(missing) if missing else skipped(reason)
    sentence = (
        'The robot drives what is commanded.'
        if ratio <= 1.0
        else f'A wheel turns {worst:.3g} rad/s slower or faster than commanded.'
    )
    verdict = passed_if(
        ratio <= 1.0, sentence, worst=worst, limit=limit, unit='rad/s', at=record.seconds(at)
    )
    return unless(verdict, missing)


def rate(record: AuditRecord) -> Verdict:
    """Whether a command comes in each control period of a run.

    During losses of odometry, and after a stop, none is expected.
    """
    limit = LATE * record.history.epochs[0].settings.control_period
    worst, at = 0.0, record.start
    for leg in record.legs:
        for run in leg.runs:
            final = to_nanoseconds(record.history.at(run.start).final_time)
            end = min(run.end, run.start + final)
            inside = (leg.commands.stamps >= run.start) & (leg.commands.stamps < end)
            stamps, moving = leg.commands.stamps[inside], leg.commands.moving[inside]
            times = np.concatenate([[run.start], stamps, [end]])
            for index, gap in enumerate(np.diff(times) / NANOSECONDS):
                stopped = 0 < index <= len(moving) and not moving[index - 1]
                begin = int(times[index])
                if gap > worst and not stopped and not _drops_out(leg, begin, gap, limit):
                    worst, at = float(gap), begin
    sentence = (
        'A command comes each control period.'
        if worst <= limit
        else f'No command comes for {worst:.3g} s while the robot is on its way.'
    )
    verdict = passed_if(
        worst <= limit, sentence, worst=worst, limit=limit, unit='s', at=record.seconds(at)
    )
    return unless(verdict, _lost_sentence(record))


def age(record: AuditRecord) -> Verdict:
    """How old the newest odometry is when the robot is commanded to move."""
    limit = record.history.epochs[0].settings.odom_timeout + _SLACK
    worst, at = -math.inf, record.start
    for leg in record.legs:
        odometry, chosen = leg.odometry, leg.commands.moving
        for each in _lost(record, leg):
            chosen &= (leg.commands.received <= each.begin) | (leg.commands.received > each.end)
        commands = leg.commands.chosen(chosen)
        latest = np.searchsorted(odometry.received, commands.received, side='right') - 1
        known = latest >= 0
        if not known.any():
            continue
        offset = float(np.median(odometry.received - odometry.stamps)) / NANOSECONDS
        ages = (commands.received - odometry.stamps[latest])[known] / NANOSECONDS
        ages -= offset if abs(offset) > _SAME_CLOCK else 0.0
        if ages.max() > worst:
            worst = float(ages.max())
            at = int(commands.stamps[known][ages.argmax()])
    if worst == -math.inf:
        return skipped('No command to move comes after any odometry.')
    sentence = (
        'Every command to move rests on fresh odometry.'
        if worst <= limit
        else f'A command to move rests on odometry that is {worst:.3g} s old.'
    )
    verdict = passed_if(
        worst <= limit, sentence, worst=worst, limit=limit, unit='s', at=record.seconds(at)
    )
    return unless(verdict, _lost_sentence(record))


def silence(record: AuditRecord) -> Verdict:
    """How long the robot is left moving while there is no odometry."""
    limit = record.history.epochs[0].settings.odom_timeout + _SLACK
    worst, at, longest = 0.0, record.start, 0.0
    for leg in record.legs:
        received, commands = leg.odometry.received, leg.commands
        gaps = np.diff(received) / NANOSECONDS
        gaps[np.isin(received[:-1], [each.begin for each in _lost(record, leg)])] = 0.0
        longest = max(longest, float(gaps.max()))
        for index in np.flatnonzero(gaps > limit):
            times = (commands.received - received[index]) / NANOSECONDS
            before = int(np.searchsorted(times, 0.0, side='right')) - 1
            moving = before >= 0 and bool(commands.moving[before])
            during = (times > 0.0) & (times <= gaps[index])
            stops = times[during & ~commands.moving]
            # A stop holds only until the next command to move.
            left = float(gaps[index]) if not len(stops) else float(stops[0])
            restarts = times[during & commands.moving]
            if len(stops) and len(restarts) and restarts[-1] > stops[-1]:
                left = float(gaps[index])
            if (moving or len(restarts)) and left > worst:
                worst, at = left, int(leg.odometry.stamps[index])
    if worst > limit:
        sentence = f'Odometry is silent, and the robot left moving, for {worst:.3g} s.'
    elif longest > limit:
        sentence = f'Odometry is silent for {longest:.3g} s, and the robot is stopped in time.'
    else:
        sentence = 'Odometry is never silent for long.'
    verdict = passed_if(
        worst <= limit, sentence, worst=worst, limit=limit, unit='s', at=record.seconds(at)
    )
    return unless(verdict, _lost_sentence(record))


def _lost(record: AuditRecord, leg: Leg) -> list[Hole]:
    """When odometry is missing in the recording and there was some: between receptions [ns].

    A decision rests on odometry that is not there, decisions themselves are missing, or nothing
    at all was recorded.
    """
    limit = record.settings.odom_timeout + _SLACK
    received, stamps = leg.odometry.received, leg.odometry.stamps
    answers = [each for each in record.decisions if not each.halted]
    at = np.array([each.received for each in answers], dtype=np.int64)
    true = np.empty(0, np.int64) if leg.truth is None else leg.truth.received
    alive = np.concatenate([leg.commands.received, at, true])
    lost = []
    for k in np.flatnonzero(np.diff(received) > limit * NANOSECONDS).tolist():
        hole = Hole(int(received[k]), int(received[k + 1]))
        first, last = np.searchsorted(at, hole).tolist()
        heard = any(stamps[k] < each.stamp < stamps[k + 1] for each in answers[first:last])
        around = answers[max(first - 1, 0) : last + 1]
        heard |= any(a.run == b.run and b.step > a.step + 1 for a, b in pairwise(around))
        if heard or not ((alive > hole.begin) & (alive < hole.end)).any():
            lost.append(hole)
    return lost


def _lost_sentence(record: AuditRecord) -> str:
    stamps = []
    for leg in record.legs:
        for each in _lost(record, leg):
            k = np.searchsorted(leg.odometry.received, each).tolist()
            stamps.append(Hole(*(int(leg.odometry.stamps[index]) for index in k)))
    return f'Odometry is not recorded {in_words(stamps, record.start)}.' if stamps else ''


def _held(leg: Leg, settings: GuidanceSettings) -> tuple[IntArray, IntArray, Array]:
    """The last part of the time for which each command holds, and the command."""
    stamps, twists = leg.commands.stamps, leg.commands.twists
    effects = stamps + round(settings.command_delay * NANOSECONDS)
    begins, ends = effects[:-1], effects[1:]
    durations = ends - begins
    periods = durations / (settings.control_period * NANOSECONDS)
    chosen = (periods >= _BRIEF) & (periods <= LATE)
    chosen &= (begins >= leg.path.stamps[0]) & (ends <= leg.path.stamps[-1])
    chosen &= np.isfinite(twists[:-1]).all(axis=1)
    settled = begins + np.round(_SETTLED * durations).astype(np.int64)
    return settled[chosen], ends[chosen], twists[:-1][chosen]


def _in_words(twist: Array) -> str:
    *speeds, turn_rate = twist
    return ', '.join([*(f'{each:.4g} m/s' for each in speeds), f'{turn_rate:.4g} rad/s'])


def _drops_out(leg: Leg, begin: int, gap: float, limit: float) -> bool:
    """Whether odometry is missing in a gap for as long as makes a command late."""
    end = begin + round(gap * NANOSECONDS)
    stamps = leg.odometry.stamps
    inside = stamps[(stamps > begin) & (stamps < end)]
    times = np.concatenate([[begin], inside, [end]])
    return bool(np.diff(times).max() > (1.0 - 1.0 / LATE) * limit * NANOSECONDS)
