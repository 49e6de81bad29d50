"""Checks of what limits changes of the commands: acceleration of the wheels, and steering."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray
from cmpsp_ros.bags.audit.finding import Verdict, passed_if, skipped
from cmpsp_ros.bags.audit.record import AuditRecord
from cmpsp_ros.bags.decision_record import wheel_speeds
from cmpsp_ros.guidance.safety import CHANGE_ROUNDING

_ROUNDING: Final = 1e-9
"""Part of a steering angle that is lost on the way to a twist and back."""


def acceleration(record: AuditRecord) -> Verdict:
    """Whether the wheels can follow from each command to the next, and to the first from rest.

    A halt is exempt: it answers faults that no plan can foresee.
    """
    settings = record.history.epochs[0].settings
    limit = settings.max_wheel_change
    if not math.isfinite(limit):
        return skipped('The wheels have no such limit (robot.max_wheel_acceleration is 0).')
    wheels = _changing(record)
    changes = np.abs(np.diff(wheels, axis=0, prepend=0.0 * wheels[:1])).max(axis=1)
    changes[_unplanned(record)] = 0.0
    index = int(changes.argmax())
    worst = float(changes[index])
    passed = worst <= limit + CHANGE_ROUNDING
    sentence = (
        'The wheels can follow from each command to the next.'
        if passed
        else f'A wheel is to change by {worst:.4g} rad/s from one command to the next.'
    )
    at = record.seconds(int(record.commands.stamps[index]))
    return passed_if(passed, sentence, worst=worst, limit=limit, unit='rad/s', at=at)


def steering(record: AuditRecord) -> Verdict:
    """Whether a car is steered as far and as fast as it can be, from straight ahead at first.

    A command at rest says nothing of the steering: it is as decided, or else as before.
    """
    settings = record.history.epochs[0].settings
    limits = settings.robot.steering_limits
    if limits is None:
        return skipped('The robot is not steered (robot.model).')
    angles = _steering_angles(record)
    changes = np.abs(np.diff(angles, prepend=0.0))
    changes[_unplanned(record)] = 0.0
    most = limits[1] * settings.control_period
    parts = np.maximum(np.abs(angles) / limits[0], changes / most)
    index = int(parts.argmax())
    worst, changed = float(np.abs(angles[index])), float(changes[index])
    passed = worst <= limits[0] * (1.0 + _ROUNDING) and changed <= most + CHANGE_ROUNDING
    sentence = 'The steering can follow each command.'
    if not passed:
        sentence = (
            f'The steering angle is to be {worst:.4g} rad, {changed:.4g} rad from the one before.'
        )
    at = record.seconds(int(record.commands.stamps[index]))
    largest = float(np.abs(angles).max())
    return passed_if(passed, sentence, worst=largest, limit=limits[0], unit='rad', at=at)


def _changing(record: AuditRecord) -> Array:
    """What is limited of each command, shape ``(C, q)`` [rad/s].

    At rest, when a twist says nothing of angles, it is as decided.
    """
    robot, pairs = record.history.epochs[0].settings.robot, record.pairs
    wheels = robot.wheel_speeds(record.commands.twists)
    decided = wheel_speeds(record.decisions[pairs.decisions :][: pairs.count])
    at_rest = ~record.commands.moving[pairs.commands :][: len(decided)]
    wheels[pairs.commands :][: len(decided)][at_rest] = decided[at_rest, : wheels.shape[1]]
    return robot.rates(wheels)


def _steering_angles(record: AuditRecord) -> Array:
    """Steering angle of each command, shape ``(C,)`` [rad]."""
    robot = record.history.epochs[0].settings.robot
    said = [robot.steering_of(each) or 0.0 for each in robot.controls(record.commands.twists)]
    known = record.commands.twists[:, 0] != 0.0
    pairs = record.pairs
    if record.decisions:
        decided = [each.steering_angle for each in record.decisions[pairs.decisions :]]
        for index, angle in enumerate(decided[: pairs.count], pairs.commands):
            if angle is not None and not known[index]:
                said[index], known[index] = angle, True
    for index, each in enumerate(known):
        if not each:
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
    unplanned[: pairs.commands + 1] = decisions[pairs.decisions].step > 0
    answered = decisions[pairs.decisions :][: pairs.count]
    for index, (before, after) in enumerate(pairwise(answered), pairs.commands + 1):
        is_next = after.run == before.run and after.step <= before.step + 1
        unplanned[index] = after.halted or not is_next
    return unplanned
