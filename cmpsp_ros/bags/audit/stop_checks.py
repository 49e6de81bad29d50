"""Checks of times: commands and stops in time, the goal at its time, and fallback levels."""

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise, zip_longest
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.bags.audit.command_checks import LATE
from cmpsp_ros.bags.audit.finding import NotJudgedError, Sample, SkippedError, check
from cmpsp_ros.bags.audit.legs import Leg, RunSpan
from cmpsp_ros.bags.audit.record import AuditRecord
from cmpsp_ros.bags.decision_record import DecisionRecord
from cmpsp_ros.bags.runs import in_words
from cmpsp_ros.bags.runs.odometry import Hole, holes
from cmpsp_ros.bags.runs.run import Passing
from cmpsp_ros.guidance import (
    GOAL,
    NANOSECONDS,
    FallbackLevel,
    Goal,
    GuidanceSettings,
    to_nanoseconds,
)
from cmpsp_ros.robots.motion import speeds_and_turns

# Time that may lie between a node's clock and its timers, and a recorder's [s].
_SLACK: Final = 0.15
# Difference from which times of reception are taken for those of another clock [s].
_SAME_CLOCK: Final = 10.0
_ROUNDING: Final = 1e-9  # of times of goals [s]
_MOVED: Final = 0.01  # distance beyond which a robot without commands is not at rest [m]


def _odometry_gap(record: AuditRecord, _worst: Sample) -> str:
    found = [
        Hole(*leg.odometry.instants(np.array(each)).tolist())
        for leg in record.legs
        for each in _lost(record, leg)
    ]
    return f'Odometry is not recorded {in_words(found, record.start)}.' if found else ''


def _uncommanded(record: AuditRecord, _worst: Sample) -> str:
    begins = {int(leg.odometry.received[0]) for leg in record.legs}
    moves = [
        Hole(int(each.stamps[0]), int(each.stamps[-1]))
        for each in record.odometry.legs(record.settings.odom_timeout)
        if int(each.received[0]) not in begins and np.ptp(each.poses[:, :2], axis=0).max() > _MOVED
    ]
    return f'The robot moves {in_words(moves, record.start)} without any command.' if moves else ''


@check(
    'rate', 'Commands: in time', needs=('control_period', 'final_time'), unit='s',
    good='A command comes each control period.',
    bad='No command comes for {worst:.3g} s while the robot is on its way.',
    gaps=(_odometry_gap, _uncommanded),
)  # fmt: skip
def rate(record: AuditRecord) -> Iterator[Sample]:
    """Time from each command of a run to the next, by stamps and as received; not after a stop."""
    yield Sample.upper(0.0, LATE * record.settings.control_period, record.start)
    for leg in record.legs:
        commands = leg.commands
        usual = float(np.median(np.diff(leg.odometry.stamps)))
        for run in leg.runs:
            settings, worst = leg.history.at(run.start), 0.0
            limit = LATE * settings.control_period
            # For so long odometry must be missing to make a command late [ns].
            longest = (1.0 - 1.0 / LATE) * limit * NANOSECONDS
            end = min(run.end, run.start + to_nanoseconds(settings.final_time))
            inside = (commands.stamps >= run.start) & (commands.stamps < end)
            is_expected = np.append(True, commands.moving[inside])
            last = next(iter(leg.arrivals[commands.stamps >= end]), end)
            for stamps, final, slack in ((commands.stamps, end, 0.0), (leg.arrivals, last, _SLACK)):
                times = np.concatenate([[run.start], stamps[inside], [final]])
                gaps = np.diff(times) / NANOSECONDS - slack
                for k in np.flatnonzero(is_expected & (gaps > worst)).tolist():
                    begin, until = int(times[k]), int(times[k + 1])
                    found = holes(leg.odometry.stamps, begin, until, longest)
                    silent = np.array([each.end - each.begin for each in found])
                    # Where odometry is slow, a command comes with the first after it is due.
                    lost = max(silent.max(initial=0), silent[silent > LATE * usual].sum())
                    is_late = gaps[k] - lost / NANOSECONDS > limit
                    if gaps[k] > worst and (is_late or not found):
                        worst = float(gaps[k])
                        yield Sample.upper(worst + slack, limit + slack, begin)


@check(
    'age', 'Commands: fresh odometry', needs=('odom_timeout',), unit='s',
    good='Every command to move rests on fresh odometry.',
    bad='A command to move rests on odometry that is {worst:.3g} s old.', gaps=(_odometry_gap,),
)  # fmt: skip
def age(record: AuditRecord) -> Iterator[Sample]:
    """Age of the odometry that a command to move rests on, or of the newest if that is older."""
    is_any = False
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
        basis = np.minimum(commands.stamps, odometry.stamps[latest])
        ages = (commands.received - basis)[known] / NANOSECONDS
        ages -= offset if abs(offset) > _SAME_CLOCK else 0.0
        is_any, stamps = True, commands.stamps[known]
        limits = _timeouts(leg, stamps)
        yield Sample.largest(ages, limits, stamps, ages - limits)
    if not is_any:
        raise SkippedError('No command to move comes after any odometry.')


def _silence_in_words(worst: Sample) -> str:
    longest = worst.words['longest']
    said = f'Odometry is silent for {longest:.3g} s, and the robot is stopped in time.'
    return said if longest else 'Odometry is never silent for long.'


@check(
    'silence', 'Stop: without odometry', needs=('odom_timeout',), unit='s',
    good=_silence_in_words,
    bad='Odometry is silent, and the robot left moving, for {worst:.3g} s.',
    gaps=(_odometry_gap,),
)  # fmt: skip
def silence(record: AuditRecord) -> Iterator[Sample]:
    """Time for which the robot is left moving without odometry."""
    limit, longest = record.settings.odom_timeout + _SLACK, 0.0
    worst = Sample.upper(0.0, limit, record.start)
    for leg in record.legs:
        received, commands = _receptions(leg), leg.commands
        gaps = np.diff(received) / NANOSECONDS
        gaps[np.isin(received[:-1], [each.begin for each in _lost(record, leg)])] = 0.0
        limits = _timeouts(leg, leg.odometry.stamps)
        longest = max(longest, float(gaps[gaps > limits].max(initial=0.0)))
        for index in np.flatnonzero(gaps > limits):
            times = (commands.received - received[index]) / NANOSECONDS
            before = int(np.searchsorted(times, 0.0, side='right')) - 1
            moving = before >= 0 and bool(commands.moving[before])
            during = (times > 0.0) & (times <= gaps[index])
            stops, restarts = times[during & ~commands.moving], times[during & commands.moving]
            # A stop holds only until the next command to move.
            is_stopped = len(stops) and not (len(restarts) and restarts[-1] > stops[-1])
            left = float(stops[0] if is_stopped else gaps[index])
            if moving or len(restarts):
                at = int(leg.odometry.stamps[index])
                found = Sample.upper(left, float(limits[index]), at)
                worst = max(worst, found, key=lambda each: each.order)
    yield replace(worst, words={'longest': longest})


@check(
    'stop_at_end', 'Stop: at the end', needs=('control_period',),
    good='The last command is a stop.',
    bad='The last command is no stop but {speed:.3g} m/s, {turn:.3g} rad/s.',
)  # fmt: skip
def stop_at_end(record: AuditRecord) -> Iterator[Sample]:
    """Speed of the last command."""
    leg = record.legs[-1]
    last, received = int(leg.commands.stamps[-1]), int(leg.odometry.stamps[-1])
    run = leg.runs[-1]
    settings = leg.history.at(run.start)
    speed, turn = speeds_and_turns(leg.commands.twists[-1])
    final = run.start + to_nanoseconds(settings.final_time)
    is_under_way = received - last <= LATE * settings.control_period * NANOSECONDS
    if leg.commands.moving[-1] and received < final and is_under_way:
        raise NotJudgedError('The recording ends while the robot is on its way.')
    value = math.hypot(speed, turn)
    excess = value if leg.commands.moving[-1] else 0.0
    yield Sample(value, 0.0, last, excess, words={'speed': speed, 'turn': turn})


@check(
    'reasons', 'Fallback: reasons given', of_decisions=True,
    good='All {total} decisions say why.',
    bad='Of {total} decisions {worst:.0f} should not be; the first {what}.',
)  # fmt: skip
def reasons(record: AuditRecord) -> Iterator[Sample]:
    """Number of decisions with an unknown level, no reason, or a stop that is none."""
    wrong = [(each.stamp, _wrong_with(record, each)) for each in record.decisions]
    wrong = [(stamp, what) for stamp, what in wrong if what]
    at, what = wrong[0] if wrong else (None, '')
    yield Sample.count(len(wrong), at, total=len(record.decisions), what=what)


def _wrong_with(record: AuditRecord, decision: DecisionRecord) -> str:
    level, settings = decision.level, record.history.received_by(decision.received).settings
    if level not in {each.name.lower() for each in FallbackLevel}:
        return f'has level {level!r}, which does not exist'
    if not decision.reason.strip():
        return f'has level {level} without a reason'
    turns = settings.robot.twist_of_wheels(decision.wheel_speeds).any()
    if level == 'stop' and turns and not math.isfinite(settings.max_wheel_change):
        return 'has level stop with wheels that turn'
    if decision.finished and level != 'stop':
        return f'has level {level} after the final time'
    return ''


@check(
    'previous_plan', 'Fallback: old plans dropped', needs=('failure_tolerance',),
    of_decisions=True, unit='steps', good='No old plan is followed for too long.',
    bad='An old plan is followed for {worst:.0f} control steps in a row (failure_tolerance).',
)  # fmt: skip
def previous_plan(record: AuditRecord) -> Iterator[Sample]:
    """Control steps in a row in which an old plan is followed."""
    row, limit = 0, float(record.settings.failure_tolerance)
    yield Sample(0.0, limit, None, -limit)
    for each in record.decisions:
        # A plan that came too late was made anew: no step has failed.
        row = row + 1 if each.level == 'previous_plan' and each.failures else 0
        limit = float(record.history.received_by(each.received).settings.failure_tolerance)
        if row:
            yield Sample.upper(float(row), limit, each.stamp)


def _goal_in_words(worst: Sample) -> str:
    passing: Passing = worst.words['passing']
    name, goals = passing.goal.name, worst.words['goals']
    when = f'At {passing.goal.time:g} s' if name not in ('', GOAL) else 'At the final time'
    count = f' It is the worst of {goals} goals.' if goals > 1 else ''
    if worst.passes:
        return f'{when} the robot is {passing}.{count}'
    why = worst.words['why']
    return f'{when} the robot is {passing}, which is beyond its tolerance.{why}{count}'


@check(
    'goal', 'Path: goal at the final time',
    needs=('goal.position', 'goal.tolerance', 'final_time'), unit='m', good=_goal_in_words,
    bad=_goal_in_words, gaps=(lambda record, _: _passings(record)[1],),
)  # fmt: skip
def goal(record: AuditRecord) -> Iterator[Sample]:
    """Miss at each goal at its time, in each run that was not begun again before."""
    if record.settings.follow is not None:
        raise SkippedError('There is no goal: a road is followed (follow.speed).')
    passings, missing = _passings(record)
    if not passings:
        raise NotJudgedError(missing or 'No run lasts until the time of its goal.')
    goals = len({each.stamp for each, _ in passings})
    for each, settings in passings:
        after = (last.why_given_up for last in record.decisions if last.stamp >= each.stamp)
        why = next((f' {reason}' for reason in after if reason), '')
        words, limit = {'passing': each, 'goals': goals, 'why': why}, settings.goal_tolerance
        yield Sample(each.miss, limit, each.stamp, each.ratio - 1.0, words=words)


def _passings(record: AuditRecord) -> tuple[list[tuple[Passing, GuidanceSettings]], str]:
    passings, missing = [], ''
    for leg in record.legs:
        for run in leg.runs:
            is_last = run is record.legs[-1].runs[-1]
            for place in _goals_of(leg, run):
                stamp = run.start + to_nanoseconds(place.time)
                if stamp > run.end and not is_last:
                    continue
                settings = leg.history.at(stamp)
                poses = [pose for each in leg.known if (pose := each.at(stamp)) is not None]
                found = (Passing.of(settings, place, stamp, pose) for pose in poses)
                passings += [(each, settings) for each in found]
                if stamp > run.end and is_last:
                    early = (stamp - run.end) / NANOSECONDS
                    missing = f'The recording ends {early:.3g} s before the final time.'
                elif not poses:
                    missing = f'No pose is recorded at {place.time:g} s, the time of a goal.'
    return passings, missing


def _goals_of(leg: Leg, run: RunSpan) -> list[Goal]:
    """Goals of a run that were in force at their times; later ones replace pending ones."""
    may_move = leg.history.at(run.start).moves_final_time
    received = [each for each in leg.decisions if run.start <= each.stamp <= run.end]
    received = [
        each for each in received if each.goal is not None and (each.goals_received or may_move)
    ]
    until = math.inf if not received else (received[0].stamp - run.start) / NANOSECONDS
    goals = []
    for goal in leg.history.at(run.start).goals:
        then = leg.history.at(run.start + round(goal.time * NANOSECONDS)).goals
        same = next((each for each in then if (each.name or GOAL) == (goal.name or GOAL)), None)
        if goal.time <= until and same is not None:
            goals.append(replace(same, time=goal.time))
    for each, after in zip_longest(received, received[1:]):
        assert each.goal is not None  # noqa: S101 (looked at above)
        goal, next_goal = each.goal, None if after is None else after.goal
        if next_goal == goal:
            continue
        end = math.inf if after is None else (after.stamp - run.start) / NANOSECONDS
        # It may be put off at the very instant at which it is due.
        is_put_off = next_goal is not None and next_goal == replace(goal, time=next_goal.time)
        if goal.time < end - _ROUNDING if is_put_off else goal.time <= end + _ROUNDING:
            goals.append(goal)
    return goals


def _lost(record: AuditRecord, leg: Leg) -> list[Hole]:
    """When odometry was there but not recorded, between receptions [ns].

    A decision rests on odometry that is not there, decisions are missing, or nothing was
    recorded.
    """
    received, limits = _receptions(leg), _timeouts(leg, leg.odometry.stamps) * NANOSECONDS
    stamps = np.append(leg.odometry.stamps, np.iinfo(np.int64).max)
    answers = [each for each in record.decisions if not each.halted]
    at = np.array([each.received for each in answers], dtype=np.int64)
    true = np.empty(0, np.int64) if leg.truth is None else leg.truth.received
    alive = np.concatenate([leg.commands.received, at, true])
    lost = []
    for k in np.flatnonzero(np.diff(received) > limits).tolist():
        hole = Hole(int(received[k]), int(received[k + 1]))
        first, last = np.searchsorted(at, hole).tolist()
        heard = any(stamps[k] < each.stamp < stamps[k + 1] for each in answers[first:last])
        around = answers[max(first - 1, 0) : last + 1]
        heard |= any(a.run == b.run and b.step > a.step + 1 for a, b in pairwise(around))
        if heard or not ((alive > hole.begin) & (alive <= hole.end)).any():
            lost.append(hole)
    return lost


def _receptions(leg: Leg) -> IntArray:
    """Receptions of odometry, and of the last message after it, up to which it may be silent."""
    others = [leg.commands] if leg.truth is None else [leg.commands, leg.truth]
    last = max(int(each.received[-1]) for each in (leg.odometry, *others))
    return np.append(leg.odometry.received, last)


def _timeouts(leg: Leg, stamps: IntArray) -> Array:
    """Age from which on odometry counts as silent, in force at instants ``(M,)`` [ns], [s]."""
    timeouts = np.array([each.settings.odom_timeout for each in leg.history.epochs])
    return np.asarray(timeouts[leg.history.index(stamps)] + _SLACK)
