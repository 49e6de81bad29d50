"""Passive motion safety: nothing that moves can reach the robot before it is at rest.

Each command and the stop after it are clear of every place that a moving obstacle may reach by
then. By induction, nothing touches the robot while it moves.
"""

from typing import Final, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.robots import placed
from cmpsp_ros.world.obstacles import ROUGHNESS, MovingDiscs

_ROUNDING: Final = 1e-6

LOST: Final = 0.5  # three standard deviations of a position that is out of sight [m]
_APART: Final = 1.0  # distance from such an obstacle from which the robot drives away [m]

CREEP: Final = 0.05
"""Speed up to which the robot counts as standing [m/s]: faster, a contact would be one of a robot
that moves."""


class _Sets(NamedTuple):
    """Obstacles about a start, grown by the robot."""

    pose: Array  # pose at the start
    moving: MovingDiscs  # what may be reached from there
    discs: MovingDiscs  # the same, grown
    begins: Array  # its clearance at the start [m]
    seen: MovingDiscs  # the same obstacles as they were seen, at rest there
    there: Array  # their clearance at the start [m]
    stands: BoolArray  # whether each stood when it was seen
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
        moving = start.reachable
        if not moving.names:
            return ''
        twists = start.robot.twist(controls)
        moves = np.flatnonzero(twists.any(axis=1))
        if not len(moves):
            return ''
        count = int(moves[-1]) + 1
        twists, durations = twists[:count], durations[:count]
        sets = self._sets(start)
        poses = start.robot.roll_out(start.pose, controls[:count], durations)[:-1]
        times = np.cumsum(durations) - durations
        arcs = poses, twists, durations, times, self._discs
        begins, there, touched = sets.begins, sets.there, sets.there < 0.0
        swept = sets.discs.along(*arcs)
        least = swept.min(axis=0)
        short = np.where(begins < 0.0, begins - ROUGHNESS, 0.0) - least
        if sets.is_lost.any():
            at_rest = np.tile(start.pose, (count, 1)), np.zeros_like(twists), *arcs[2:]
            nearer = (sets.discs.along(*at_rest) - swept).max(axis=0)
            short[sets.is_lost & (nearer <= ROUGHNESS)] = 0.0
        short[touched] = np.inf
        if np.abs(self._footprint.speeds_and_turns(twists)[:, 0]).max() <= CREEP:
            kept = np.where(sets.stands, np.minimum(there, 0.0), there) - ROUGHNESS
            short[sets.seen.along(*arcs).min(axis=0) >= kept] = 0.0
        worst = int(short.argmax())
        if short[worst] <= _ROUNDING:
            return ''
        name = moving.names[worst]
        if touched[worst]:
            return f'{name} touches the robot, which creeps at most until it has gone.'
        return f'{name} could be {-float(least[worst]):.3g} m into the robot before it is at rest.'

    def _sets(self, start: PlanStart) -> _Sets:
        """Sets that may be reached from a start; a step asks for many paths from the same one."""
        known = self._known
        if known is None or known.pose is not start.pose or known.moving is not start.reachable:
            discs = start.reachable.grown(self._radius)
            seen = start.touchable.grown(self._radius)
            stands = np.hypot(*seen.states[:, 2:4].T) <= CREEP
            begins, there = self._clearance(start, discs), self._clearance(start, seen)
            is_lost = discs.states[:, 4] - seen.states[:, 4] > LOST
            toward = start.pose[:2] - seen.states[:, :2]
            is_lost &= (there > _APART) & ((toward * seen.states[:, 2:4]).sum(axis=1) <= 0.0)
            self._known = known = _Sets(
                start.pose, start.reachable, discs, begins, seen.at_rest(), there, stands, is_lost
            )
        return known

    def _clearance(self, start: PlanStart, discs: MovingDiscs) -> Array:
        places = placed(self._discs, start.pose)
        return np.asarray(np.min([discs.clearance(each) for each in places], axis=0))
