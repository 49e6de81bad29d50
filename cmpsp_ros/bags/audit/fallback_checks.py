"""Checks of the fallback levels and of the last stop."""

from __future__ import annotations

import math

import numpy as np

from cmpsp_ros.bags.audit.clearance import NOTHING_NEAR, OUT_OF_REACH
from cmpsp_ros.bags.audit.command_checks import LATE
from cmpsp_ros.bags.audit.finding import Verdict, not_judged, passed_if, skipped, unless
from cmpsp_ros.bags.audit.record import AuditRecord
from cmpsp_ros.bags.decision_record import DecisionRecord
from cmpsp_ros.guidance import NANOSECONDS, FallbackLevel, to_nanoseconds
from cmpsp_ros.robots import speeds_and_turns

_ROUNDING = 1e-6
"""What rounding may take from a clearance [m]."""


def reasons(record: AuditRecord) -> Verdict:
    """Whether every level is a known one with a reason, and every stop a stop or braking."""
    known = {level.name.lower() for level in FallbackLevel}
    wrong = []
    ramps = math.isfinite(record.history.epochs[0].settings.max_wheel_change)
    for each in record.decisions:
        if each.level not in known:
            wrong.append((each, f'has level {each.level!r}, which does not exist'))
        elif not each.reason.strip():
            wrong.append((each, f'has level {each.level} without a reason'))
        elif each.level == 'stop' and not ramps and _moves(record, each):
            wrong.append((each, 'has level stop with wheels that turn'))
        elif each.finished and each.level != 'stop':
            wrong.append((each, f'has level {each.level} after the final time'))
    if not wrong:
        return passed_if(
            True, f'All {len(record.decisions)} decisions say why.', worst=0.0, limit=0.0
        )
    first, what = wrong[0]
    return passed_if(
        False,
        f'Of {len(record.decisions)} decisions {len(wrong)} should not be; the first {what}.',
        worst=float(len(wrong)),
        limit=0.0,
        at=record.seconds(first.stamp),
    )


def previous_plan(record: AuditRecord) -> Verdict:
    """Whether an old plan is followed for longer than `failure_tolerance` allows."""
    limit = record.history.epochs[0].settings.failure_tolerance
    row, worst, at = 0, 0, record.start
    for each in record.decisions:
        # A plan that came too late was made anew: no step has failed.
        row = row + 1 if each.level == 'previous_plan' and each.failures else 0
        if row > worst:
            worst, at = row, each.stamp
    sentence = (
        'No old plan is followed for too long.'
        if worst <= limit
        else f'An old plan is followed for {worst} control steps in a row (failure_tolerance).'
    )
    return passed_if(
        worst <= limit,
        sentence,
        worst=float(worst),
        limit=float(limit),
        unit='steps',
        at=record.seconds(at) if worst else None,
    )


def nominal(record: AuditRecord) -> Verdict:
    """Whether the path driven is clear wherever the level is nominal."""
    answers = [each for each in record.decisions if not each.halted]
    if not answers:
        return skipped('No control step has level nominal.')
    stamps = np.array([each.stamp for each in answers], dtype=np.int64)
    if np.any(np.diff(stamps) < 0):
        return skipped('Time jumps back, and levels cannot be assigned by it.')
    good = np.array([each.level == 'nominal' for each in answers])
    worst, at = np.inf, record.start
    for sweep in record.evidence:
        level = np.searchsorted(stamps, sweep.stamps, side='right') - 1
        period = sweep.settings.control_period * NANOSECONDS
        under = (level >= 0) & good[np.maximum(level, 0)]
        under &= sweep.stamps - stamps[np.maximum(level, 0)] < period
        least = sweep.clearance.min(axis=1)[under] + sweep.tolerance
        if len(least) and least.min() < worst:
            worst, at = float(least.min()), int(sweep.stamps[under][least.argmin()])
    if worst == np.inf:
        return skipped('No control step has level nominal.')
    missing = record.unseen or record.hole_sentence
    if worst >= OUT_OF_REACH:
        return unless(passed_if(True, NOTHING_NEAR), missing)
    passed = worst >= -_ROUNDING
    sentence = (
        'Wherever the level is nominal, the path driven is clear.'
        if passed
        else f'While the level is nominal, the path driven is {-worst:.3g} m too close.'
    )
    figures = {'worst': worst, 'limit': 0.0, 'unit': 'm', 'at': record.seconds(at)}
    return unless(passed_if(passed, sentence, **figures), missing)


def stop_at_end(record: AuditRecord) -> Verdict:
    """Whether the last command of all is a stop."""
    leg = record.legs[-1]
    last, received = int(leg.commands.stamps[-1]), int(leg.odometry.stamps[-1])
    run = leg.runs[-1]
    settings = record.history.at(run.start)
    speed, turn = speeds_and_turns(leg.commands.twists[-1])
    figures = {'worst': math.hypot(speed, turn), 'limit': 0.0, 'at': record.seconds(last)}
    if not leg.commands.moving[-1]:
        return passed_if(True, 'The last command is a stop.', **figures)
    final = run.start + to_nanoseconds(settings.final_time)
    if received < final and received - last <= LATE * settings.control_period * NANOSECONDS:
        return not_judged('The recording ends while the robot is on its way.')
    sentence = f'The last command is no stop but {speed:.3g} m/s, {turn:.3g} rad/s.'
    return passed_if(False, sentence, **figures)


def _moves(record: AuditRecord, decision: DecisionRecord) -> bool:
    robot = record.history.at(decision.stamp).robot
    return bool(robot.twist_of_wheels(decision.wheel_speeds).any())
