"""Passive motion safety: nothing that moves can reach the robot before it is at rest.

Each command and the stop after it are clear of every place that a moving obstacle may reach by
then. By induction, nothing touches the robot while it moves.
"""

import math
from typing import Any, Final, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.robots import placed
from cmpsp_ros.world.obstacles import ROUGHNESS, MovingDiscs, put_clearance

_ROUNDING: Final = 1e-6

LOST: Final = 0.5  # three standard deviations of a position that is out of sight [m]
_APART: Final = 1.0  # distance from such an obstacle from which the robot drives away [m]

CREEP: Final = 0.05
"""Speed up to which the robot counts as standing [m/s]: faster, a contact would be one of a robot
that moves."""

_AT_REST: Final = np.zeros((1, 2))


class _Sets(NamedTuple):
    """Obstacles about a start, grown by the robot."""

    pose: Array  # pose at the start
    moving: MovingDiscs  # what may be reached from there
    discs: MovingDiscs  # the same, grown
    begins: Array  # its clearance at the start [m]
    seen: MovingDiscs  # the same obstacles as they were seen
    there: Array  # their clearance at the start [m]
    is_lost: BoolArray  # whether each is out of sight, far away, and does not come at the robot


class ReachCheck:
    """Checks paths to rest against the reachable sets of moving obstacles."""

    def __init__(self, settings: LawSettings, radius: float) -> None:
        """Take the robot's discs, each of a radius [m]."""
        self._footprint, self._radius = settings.footprint, radius
        self._discs = settings.footprint.discs
        self._known: _Sets | None = None

    def reason(self, start: PlanStart, controls: Array, durations: Array) -> str:
        """Reason why a path to rest is not clear, in a sentence; '' if it is.

        At rest nothing is asked. A robot that is within reach already may go where it is no nearer
        at any time, and away from what is out of sight, far away and does not come at it: no nearer
        at any time than at rest. Where something touches it or might, it may creep away from where
        that is seen, and past what stands.

        `controls` ``(K, r)``, `durations` ``(K,)`` [s].
        """
        if not start.reachable.names:
            return ''
        sets, robot, discs = self._sets(start), start.robot, self._discs
        times, obstacles = np.cumsum(durations) - durations, len(sets.begins)
        twists = np.ascontiguousarray(robot.twist(controls))
        poses = robot.roll_out(start.pose, controls, durations)
        found = short, least = np.empty(obstacles), np.empty(obstacles)
        swept, states = np.empty((2, len(times), obstacles)), sets.discs.on_arcs(times, durations)
        arcs, limits = (poses, twists, durations, times), (sets.begins, sets.there, sets.is_lost)
        count = _fall_short(found, swept, discs, states, arcs, limits, _AT_REST)
        if short.max() <= _ROUNDING:
            return ''
        if np.abs(self._footprint.speeds_and_turns(twists)[:, 0]).max() <= CREEP:
            stands = np.hypot(*sets.seen.states[:, 2:4].T) <= CREEP
            kept = np.where(stands, np.minimum(sets.there, 0.0), sets.there) - ROUGHNESS
            path = poses[:count], twists[:count], durations[:count], times[:count]
            short[sets.seen.at_rest().along(*path, discs).min(axis=0) >= kept] = 0.0
        worst = int(short.argmax())
        if short[worst] <= _ROUNDING:
            return ''
        name = start.reachable.names[worst]
        if sets.there[worst] < 0.0:
            return f'{name} touches the robot, which creeps at most until it has gone.'
        return f'{name} could be {-float(least[worst]):.3g} m into the robot before it is at rest.'

    def _sets(self, start: PlanStart) -> _Sets:
        """Sets that may be reached from a start; a step asks for many paths from the same one."""
        known = self._known
        if known is None or known.pose is not start.pose or known.moving is not start.reachable:
            discs = start.reachable.grown(self._radius)
            seen = start.touchable.grown(self._radius)
            places = placed(self._discs, start.pose)
            begins, there = (each.clearance(places).min(axis=0) for each in (discs, seen))
            is_lost = discs.states[:, 4] - seen.states[:, 4] > LOST
            toward = start.pose[:2] - seen.states[:, :2]
            is_lost &= (there > _APART) & ((toward * seen.states[:, 2:4]).sum(axis=1) <= 0.0)
            moving = start.reachable
            self._known = known = _Sets(start.pose, moving, discs, begins, seen, there, is_lost)
        return known


@allocation_free
def _fall_short(
    found: Any, swept: Array, points: Array, states: Array, arcs: Any, limits: Any, at_rest: Array
) -> int:
    """Sweep a path past sets as of `put_clearance`; the number of steps up to its last that moves.

    Fills in by how much each set is too near and its clearance, ``(M,)`` each, and that on each arc
    and of a robot at rest, ``(2, K, M)``. `limits` are those of `_Sets`, `at_rest` a twist.
    """
    (short, least), (poses, twists, durations, times) = found, arcs
    begins, there, is_lost = limits
    count = 0
    for k in range(twists.shape[0]):
        if twists[k].any():
            count = k + 1
    driven, standing, durations = swept[0], swept[1], durations[:count]
    put_clearance(driven, points, states, poses, twists, durations, times)
    if is_lost.any():
        put_clearance(standing, points, states, poses, at_rest, durations, times)
    for j in range(begins.shape[0]):
        least[j], is_no_nearer = math.inf, is_lost[j]
        for k in range(count):
            if driven[k, j] < least[j] or math.isnan(driven[k, j]):
                least[j] = driven[k, j]
            is_no_nearer = is_no_nearer and standing[k, j] - driven[k, j] <= ROUGHNESS
        short[j] = (begins[j] - ROUGHNESS if begins[j] < 0.0 else 0.0) - least[j]
        if count == 0 or is_no_nearer:
            short[j] = 0.0
        elif there[j] < 0.0:
            short[j] = math.inf
    return count
