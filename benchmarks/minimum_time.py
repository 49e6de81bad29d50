"""Arrival as soon as possible beside IPOPT's minimum time, with the same limits and margins.

`python -m benchmarks.minimum_time` drives a differential drive with limits of wheel speed and
acceleration from rest to rest: to five goals on open floor, past a disc to some of them, and along
two roads, with limits of the lateral acceleration and of the jerk, too. IPOPT starts from the path
driven, with as many steps, all of one duration.
"""

import math
import sys
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import NANOSECONDS, Decision, GuidanceLaw, GuidanceSettings, Observation
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file
from cmpsp_ros.studies.paper import Path, reference_solution

_LIMIT: Final = 1.03  # ratio of the times that is to be kept
_PATIENCE: Final = 300
_ROBOT: Final = {
    'goal.when': 'soonest',
    'robot.max_wheel_speed': 40.0,
    'robot.max_wheel_acceleration': 40.0,
    'safety.margin': 0.05,
}
_POST: Final[dict[str, Any]] = {
    'obstacles.names': ['post'], 'obstacles.post.center': [3.0, 0.2], 'obstacles.post.radius': 0.4,
}  # fmt: skip
_RING: Final[dict[str, Any]] = {
    'road.type': 'annulus', 'road.inner_radius': 9.0, 'road.outer_radius': 11.0,
    'goal.position': [10.0, 0.0], 'initial_pose': [0.0, -9.25, 0.0],
}  # fmt: skip
_POINTS: Final = [0.0, 0.0, 3.0, 0.8, 6.0, -0.8, 9.0, 0.8, 12.0, -0.8, 15.0, 0.0]
_SLALOM: Final[dict[str, Any]] = {
    'road.type': 'corridor', 'road.points': _POINTS, 'road.half_width': [0.6],
    'goal.position': [12.0, -0.8], 'initial_pose': [3.0, 0.8, 0.0],
}  # fmt: skip
_SMOOTH: Final = {'robot.max_wheel_jerk': 100.0, 'solver.initial_iterations': 36}
_LATERAL: Final = 'robot.max_lateral_acceleration'


def _floor(x: float, y: float, heading: float = 0.0, **changes: Any) -> dict[str, Any]:
    place = {'road.type': 'none', 'goal.position': [x, y], 'initial_pose': [0.0, 0.0, heading]}
    return {**place, **changes}


# Parameters of every course that differ from the defaults.
COURSES: Final[Mapping[str, dict[str, Any]]] = {
    'floor, straight ahead': _floor(6.0, 0.0),
    'floor, to the left': _floor(5.0, 4.0),
    'floor, beside': _floor(0.5, 3.0),
    'floor, past a disc': _floor(6.0, 0.0, **_POST),
    'floor, past a disc, aside': _floor(5.0, -2.5, 0.5, **_POST),
    'road, a ring': _RING,
    'road, a slalom': _SLALOM,
    'ring, 0.15 m/s^2 across': {**_RING, _LATERAL: 0.15},
    'slalom, 0.5 m/s^2 across': {**_SLALOM, _LATERAL: 0.5},
    'slalom, 0.2 m/s^2 across': {**_SLALOM, _LATERAL: 0.2},
    'floor, to the left, smooth': _floor(5.0, 4.0, **_SMOOTH),
    'past a disc, smooth': _floor(6.0, 0.0, **_POST, **_SMOOTH),
    'slalom, smooth': {**_SLALOM, **_SMOOTH},
}  # fmt: skip


def drive(settings: GuidanceSettings, pose: Array) -> tuple[list[Decision], Path, float]:
    """Drive by exact arcs to the end: decisions, the path between them, and its duration [s]."""
    law, period = GuidanceLaw(settings, settings.world), settings.control_period
    decisions: list[Decision] = []
    stamp, poses = 0, [pose]
    while not decisions or not decisions[-1].finished:
        if len(decisions) > _PATIENCE:
            break
        decision = law.step(Observation(stamp, poses[-1]))
        assert decision is not None  # noqa: S101 (a step is due)
        law.after_step()
        decisions.append(decision)
        end = law.ends_at
        assert end is not None  # noqa: S101 (there is a goal)
        length = round(period * NANOSECONDS)
        # Odometry also comes at the final time.
        length = end - stamp if stamp < end < stamp + 1.5 * length else length
        controls = settings.robot.controls(decision.twist)[None]
        held = np.array([length / NANOSECONDS])
        poses.append(settings.robot.roll_out(poses[-1], controls, held)[-1])
        stamp += length
    controls = np.array([settings.robot.controls(each.twist) for each in decisions[:-1]])
    path = Path(settings, np.array(poses[: len(decisions)]), controls)
    return decisions, path, decisions[-1].stamp / NANOSECONDS


def compare(name: str) -> tuple[float, float, float, int]:
    """Time driven and IPOPT's [s], error at the goal [m], and steps that were not nominal."""
    given = {**load_parameter_file('case1'), **_ROBOT, **COURSES[name]}
    values = TABLE.resolve(given)
    settings = guidance_settings(values)
    decisions, path, time = drive(settings, np.array(values['initial_pose']))
    steps = len(path.controls)
    whole = replace(settings, final_time=steps * settings.control_period)
    found = reference_solution(whole, path.poses[0], path)
    best = found.time if found.feasible else math.nan
    others = sum(each.level.name != 'NOMINAL' for each in decisions[:-1])
    return time, best, decisions[-1].terminal_error, others


def main(names: list[str]) -> int:
    """Write a table of the courses; 1 if one takes too long."""
    out = sys.stdout.write
    out(f'{"course":28} {"driven":>8} {"IPOPT":>8} {"ratio":>7} {"miss":>8}  not nominal\n')
    worst = 0.0
    for name in names or COURSES:
        time, best, miss, others = compare(name)
        ratio = time / best if best > 0.0 else math.inf
        worst = max(worst, ratio)
        out(f'{name:28} {time:6.2f} s {best:6.2f} s {ratio:7.3f} {miss:6.0e} m {others:>6}\n')
    out(f'largest ratio {worst:.3f}, wanted at most {_LIMIT}\n')
    return int(worst > _LIMIT)


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
