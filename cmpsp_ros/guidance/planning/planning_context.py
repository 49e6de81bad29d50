"""What all plans of one control step have in common."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.goals import Target
from cmpsp_ros.guidance.horizon import Horizon, shift
from cmpsp_ros.guidance.planning.homotopy.road_frame import RoadFrame, road_frame
from cmpsp_ros.guidance.planning.initial_trajectories import along_road
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.safety.audit import Verdict
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.world import World
from cmpsp_ros.world import FreeSpace


@dataclass(frozen=True)
class Encounters:
    """Moving discs, frozen where and when the robot comes nearest to them.

    Attributes:
        names: What messages call them.
        centers: Shape ``(M, 2)`` [m].
        radii: With all that is kept from them, shape ``(M,)`` [m].
    """

    names: tuple[str, ...]
    centers: Array
    radii: Array

    def taken_from(self, space: FreeSpace) -> FreeSpace:
        """A space without them, where there are any, as at one instant."""
        if not self.names:
            return space
        still = space if space.radii.ndim == 1 else replace(space, radii=np.median(space.radii, 0))
        taken = still.with_points(self.centers[None], self.radii[None])
        return replace(taken, radii=taken.radii[0])


_NONE = Encounters((), np.empty((0, 2)), np.empty(0))


@dataclass
class PlanningContext:
    """A control step that plans are made for.

    Attributes:
        settings: All settings of the guidance law.
        start: Where they begin.
        goal: What the robot is to meet.
        horizon: Their horizon.
        plan: The one followed until now, if any.
        pending: Verdict on the path to where they begin, if there is one.
        halvings: How often the work of the step is halved.
        delay: From a command to its effect [ns].
        end_speed: Largest speed of a car at their end; infinite for none [m/s].
    """

    settings: LawSettings
    start: PlanStart
    goal: Target
    horizon: Horizon
    plan: Plan | None = None
    pending: Verdict | None = None
    halvings: int = 0
    delay: int = 0
    end_speed: float = math.inf

    @classmethod
    def at_pose(
        cls,
        settings: LawSettings,
        world: World,
        pose: Array,
        horizon: Horizon,
        previous_control: Array | None = None,
    ) -> PlanningContext:
        """To plan from a pose to the goal of the settings, without a plan or pending commands."""
        previous = settings.robot.at_rest if previous_control is None else previous_control
        start = PlanStart(pose, settings.robot, world, previous_control=previous)
        return cls(settings, start, settings.target, horizon)

    @cached_property
    def target(self) -> Target:
        """What plans are to meet at their end: one step alone meets no heading beside a point."""
        goal = self.goal
        if len(self.horizon.durations) > 1 or goal.is_line or goal.heading is None:
            return goal
        return goal._replace(heading=None)

    @property
    def at_rest(self) -> bool:
        """Whether no plan is being followed."""
        return self.plan is None

    @cached_property
    def center_line_guess(self) -> Array:
        """Controls along the centre line, shape ``(N + 1, r)``."""
        return along_road(self.settings, self.start, self.target, self.horizon.durations)

    @cached_property
    def road_frame(self) -> RoadFrame:
        """Road coordinates of the way to the goal."""
        return road_frame(self.settings, self.start, self.target)

    @cached_property
    def encounters(self) -> Encounters:
        """Where each moving disc is when the robot comes nearest to it.

        Along the plan that is followed, or along the road without one.
        """
        start, settings, moving = self.start, self.settings, self.start.moving
        if not len(moving):
            return _NONE
        durations, plan = self.horizon.durations, self.plan
        controls = (
            self.center_line_guess
            if plan is None
            else shift(plan.controls, plan.horizon, self.horizon)
        )
        poses = settings.robot.roll_out(start.pose, controls, durations)
        centers, radii = moving.at_times(np.concatenate([[0.0], np.cumsum(durations)]))
        away = centers - poses[:, None, :2]
        nearest = np.argmin(np.hypot(away[..., 0], away[..., 1]) - radii, axis=0)
        each = np.arange(len(moving))
        kept = settings.robot_radius + settings.safety.margin
        return Encounters(moving.names, centers[nearest, each], radii[nearest, each] + kept)
