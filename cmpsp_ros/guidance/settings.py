"""The numbers of the guidance law, as one immutable value."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Final, Self

from cmpsp_ros.guidance.goals import Follow, Goal, Target
from cmpsp_ros.guidance.solver_settings import (
    InitialGuess,
    MovingObstacles,
    Safety,
    SolverSettings,
    TaskSettings,
    Weights,
)
from cmpsp_ros.robots import Bodies, Footprint, Robot
from cmpsp_ros.sensing import SightSettings

GOAL: Final = 'goal'  # name of the last of several goals

_SEEN_AT_A_TIME: Final = 8  # moving obstacles in plans if only sensors or trackers tell
_FRACTION_OF_TOP_SPEED, _WITHOUT_LIMIT = 0.8, 1.0


@dataclass(frozen=True)
class LawSettings(TaskSettings):
    """Numbers that the law depends on; road and obstacles are the `World`."""

    robot: Robot
    goal: tuple[float, float]  # point to pass at the final time (x, y) [m]
    goal_heading: float | None = None  # heading to pass it with [rad]; None for any
    # Time to pass the goal, from the first odometry [s]; to stop on a road that is followed.
    final_time: float = 10.0
    waypoints: tuple[Goal, ...] = ()  # goals before it, by increasing times
    follow: Follow | None = None  # settings to follow a road; there is no goal then
    moving_obstacles: MovingObstacles = field(default_factory=MovingObstacles)
    sight: SightSettings = field(default_factory=SightSettings)
    robot_radius: float = 0.0  # radius of each disc of the footprint [m]
    footprint: Footprint = field(default_factory=Footprint)
    weights: Weights = field(default_factory=Weights)
    solver: SolverSettings = field(default_factory=SolverSettings)
    initial_guess: InitialGuess = field(default_factory=InitialGuess)
    safety: Safety = field(default_factory=Safety)
    # Pose where a run begins [m, m, rad], of which the position counts; None for the road.
    start_pose: tuple[float, float, float] | None = None

    @property
    def max_wheel_change(self) -> float:
        """Maximum wheel-speed change between commands, for any step [rad/s]; may be infinite."""
        return self.robot.max_wheel_acceleration * self.control_period

    @property
    def max_second_difference(self) -> float:
        """Maximum change of that change between commands [rad/s]; may be infinite."""
        return self.robot.max_wheel_jerk * self.control_period**2

    @cached_property
    def comes_to_rest(self) -> bool:
        """True if plans end at rest, where the limit of acceleration makes that a difference."""
        return self.is_soonest and self.max_wheel_change < math.inf

    @cached_property
    def plan_weights(self) -> Weights:
        """Weights of the cost of plans: where they only have to be early, of changes alone."""
        if not self.is_soonest:
            return self.weights
        return replace(self.weights, road_center=0.0, control_effort=0.0)

    @cached_property
    def tracked(self) -> MovingObstacles:
        """Settings for moving obstacles, with room for those that sensors or trackers see."""
        moving, sight = self.moving_obstacles, self.sight
        if moving.capacity or not (moving.trackers or (sight.sensors and sight.moving)):
            return moving
        return replace(moving, capacity=_SEEN_AT_A_TIME)

    @property
    def target(self) -> Target:
        """Terminal target of a plan for the last goal alone."""
        return Target(self.goal, self.goal_heading, is_line=self.follow is not None)

    @property
    def longest_horizon(self) -> float:
        """Longest time that a plan is made for [s]."""
        return self.final_time if self.follow is None else self.follow.horizon

    @property
    def goals(self) -> tuple[Goal, ...]:
        """All goals, in the order in which they are passed; none where a road is followed."""
        if self.follow is not None:
            return ()
        name = GOAL if self.waypoints or self.moves_final_time else ''
        return (*self.waypoints, Goal(self.goal, self.final_time, self.goal_heading, name))

    @property
    def pace(self) -> float:
        """Speed along the road where no time says it [m/s]."""
        top = self.robot.max_speed
        return self.nominal_speed or (
            _FRACTION_OF_TOP_SPEED * top if math.isfinite(top) else _WITHOUT_LIMIT
        )

    def tolerates(self, error: float, heading_error: float | None, tolerances: float = 1.0) -> bool:
        """True for errors [m, rad] at the goal within so many tolerances; None for no heading."""
        turned = heading_error or 0.0
        limits = tolerances * self.goal_tolerance, tolerances * self.heading_tolerance
        return error <= limits[0] and turned <= limits[1]

    def has_numbers_of(self, other: LawSettings) -> bool:
        """True if all numbers are the same, in any world."""
        names = (each.name for each in fields(LawSettings))
        return all(getattr(self, name) == getattr(other, name) for name in names)

    def towards(self, goal: Goal, begin: float = 0.0) -> Self:
        """The same with one goal alone, the way to which begins at a time [s]."""
        return replace(
            self,
            goal=goal.position,
            goal_heading=goal.heading,
            final_time=goal.time - begin,
            waypoints=(),
        )

    @property
    def kept(self) -> float:
        """Distance of the centres of the robot's discs from everything [m]."""
        return self.robot_radius + self.safety.margin

    @property
    def circumscribed_radius(self) -> float:
        """Radius about the reference point that contains all discs [m]."""
        return self.footprint.reach + self.robot_radius

    @property
    def inscribed_radius(self) -> float:
        """Radius about the reference point that is inside the footprint at any heading [m]."""
        return self.footprint.inscribed if self.footprint.corners else self.robot_radius

    @property
    def bodies(self) -> Bodies:
        """Disc covers of the robot's outline; its clearance is the largest of theirs."""
        discs = self.footprint.discs, self.robot_radius
        return (discs, self.footprint.outline) if self.footprint.corners else (discs,)
