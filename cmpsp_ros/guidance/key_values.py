"""A decision in words and numbers, as messages and bags hold it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Final

import numpy as np

from cmpsp_ros.guidance.decision import Decision, FallbackLevel, Plan
from cmpsp_ros.guidance.messages.tracks import track_keys

if TYPE_CHECKING:
    from cmpsp_ros.robots import Robot

MOVING = 'moving_obstacles'
"""Key of the obstacles that move, by number and time; there only where there are some."""

WHEELS = 'wheel_speeds'
"""Key of the speeds of a robot with more wheels than two."""

_TWO_WHEELS = 'wheel_speed_right', 'wheel_speed_left'
_STEERING = 'steering_angle'

_FORMER: Final[Mapping[str, str]] = MappingProxyType(
    {
        'rung': 'fallback_level',
        'miss': 'terminal_error',
        'margin': 'clearance',
        'worst_margin': 'worst_clearance',
        'heading_miss': 'heading_error',
        'told': 'goals_received',
    }
)
"""What earlier versions called some keys."""

_PREVIOUS_PLAN = 'previous_plan', 'shifted'
"""A fallback level, and what earlier versions called it."""


def decision_to_key_values(decision: Decision) -> dict[str, str]:
    """Everything about a decision but its reason and its plan, as text by key.

    Floats are written so that they read back bit for bit; times end in ``_ms``. Without slip
    nothing is said of it.
    """
    values: dict[str, object] = {
        'step': decision.step,
        'stamp': decision.stamp,
        'fallback_level': decision.level.name.lower(),
        'time_left': decision.time_left,
        **_of_wheels(decision),
        'terminal_error': decision.terminal_error,
        'clearance': decision.clearance,
        'worst_clearance': decision.worst_clearance,
        'slack': decision.slack,
        'iterations': decision.iterations,
        'qp_iterations': decision.qp_iterations,
        'active_rows': decision.active_rows,
        'failures': decision.failures,
        **({'wheel_slip': decision.wheel_slip} if decision.wheel_slip > 0.0 else {}),
        **_of_response(decision),
        **({'prediction_error': decision.prediction_error} if decision.prediction_error else {}),
        'finished': decision.finished,
        'missed': decision.missed,
        'halted': decision.halted,
        **({'cancelled': True} if decision.cancelled else {}),
        **({'braking': True} if decision.braking else {}),
        **({'late': decision.late} if decision.late > 0.0 else {}),
        **({'skipped': True} if decision.skipped else {}),
        **({'pose': ' '.join(map(repr, decision.pose))} if decision.pose else {}),
        'run': decision.run,
        'revision': decision.revision,
        **({MOVING: track_keys(decision.tracks)} if decision.tracks else {}),
        **({} if decision.sighting is None else {'sighting': decision.sighting}),
        **_of_goal(decision),
        **{f'{phase}_ms': time for phase, time in decision.phases.items()},
    }
    return {key: exact_repr(value) for key, value in values.items()}


def is_at_rest(values: Mapping[str, str], robot: Robot) -> bool:
    """Whether key values of a decision are those of one that stops the robot."""
    keys = *_TWO_WHEELS, WHEELS, _STEERING
    wheels = ' '.join(values[key] for key in keys if key in values).split()
    return not robot.twist_of_wheels(np.array(wheels, dtype=float)).any()


def _of_wheels(decision: Decision) -> dict[str, object]:
    speeds = decision.wheel_speeds.tolist()
    if len(speeds) == len(_TWO_WHEELS):
        return dict(zip(_TWO_WHEELS, speeds, strict=True))
    steering = decision.steering_angle
    of_car = {} if steering is None else {_STEERING: steering}
    return {WHEELS: ' '.join(map(repr, speeds)), **of_car}


def _of_response(decision: Decision) -> dict[str, object]:
    """Delay and lag of the response to commands, each with its interval, where estimated."""
    intervals = {'wheel_lag': decision.wheel_lag, 'response_delay': decision.response_delay}
    return {
        f'{key}{end}': value
        for key, interval in intervals.items()
        for end, value in zip(('', '_min', '_max'), interval or (), strict=False)
    }


def _of_goal(decision: Decision) -> dict[str, object]:
    """The goal, where it has a name, a heading, or was received."""
    goal, values = decision.goal, dict[str, object]()
    if goal is not None and goal.name:
        (x, y), time = goal.position, goal.time
        values |= {'goal': goal.name, 'goal_x': x, 'goal_y': y, 'goal_time': time}
        values |= {} if goal.heading is None else {'goal_heading': goal.heading}
    if decision.heading_error is not None:
        values['heading_error'] = decision.heading_error
    if decision.goals_received:
        values['goals_received'] = decision.goals_received
    return values


def with_former_keys(values: Mapping[str, str]) -> dict[str, str]:
    """Key values with those of the version before after them, which goes on for one release."""
    former = {old: values[key] for old, key in _FORMER.items() if key in values}
    level, before = _PREVIOUS_PLAN
    if former.get('rung') == level:
        former['rung'] = before
    return {**values, **former}


def present_keys(pairs: Iterable[tuple[str, str]]) -> dict[str, str]:
    """Key values as this version names them, of this version or of the one before."""
    found = dict(pairs)
    for old, key in _FORMER.items():
        if old in found:
            found.setdefault(key, found[old])
            del found[old]
    level, before = _PREVIOUS_PLAN
    if found.get('fallback_level') == before:
        found['fallback_level'] = level
    return found


def response_ms(step_ms: float, odometry_to_command_ms: float, command_delay: float) -> float:
    """Response time of a control step [ms]: beyond the control period its deadline is missed.

    Args:
        step_ms: Computing time, by the clock of the computer [ms].
        odometry_to_command_ms: From the stamp of the odometry to the command, in ROS time [ms].
        command_delay: Part of the latter that the prediction includes [s].
    """
    return max(step_ms, odometry_to_command_ms - 1e3 * command_delay)


def severity(decision: Decision) -> int:
    """0 where all is well, 1 for a warning, 2 for an error, as in diagnostics.

    Having arrived is no error, nor is a goal that was cancelled, and having missed the goal a
    warning: the robot stands safely.
    """
    if decision.finished or decision.cancelled:
        return int(decision.missed)
    if decision.level == FallbackLevel.NOMINAL:
        return int(decision.late > 0.0)
    return 2 if decision.level == FallbackLevel.STOP else 1


def waypoints(plan: Plan) -> list[tuple[float, float, float, float]]:
    """Poses of a plan: ``x`` and ``y`` [m], then ``z`` and ``w`` of the quaternion."""
    return [
        (x, y, math.sin(heading / 2.0), math.cos(heading / 2.0))
        for x, y, heading in plan.poses.tolist()
    ]


def exact_repr(value: object) -> str:
    """A value as text that reads back bit for bit; truth is `true` or `false`."""
    if isinstance(value, bool):
        return 'true' if value else 'false'
    return repr(float(value)) if isinstance(value, float) else str(value)
