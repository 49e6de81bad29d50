"""Everything the guidance law is told before it starts, as one immutable value."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.mission.goals import Follow, Goal
from cmpsp_ros.robots.differential_drive import DifferentialDrive
from cmpsp_ros.world.obstacles.shapes import Shape
from cmpsp_ros.world.roads.road import Annulus, Road

Array = NDArray[np.float64]

GOAL: Final = 'goal'
"""Name of the last of several goals."""

SCREENING: Final = 6
"""Initial iterations after which plans are compared."""

_PART_OF_TOP, _WITHOUT_TOP = 0.8, 1.0


@dataclass(frozen=True)
class Weights:
    """Weights of the cost (95) and of the two true control costs beside it.

    Attributes:
        road_center: ``q`` of (95), on the squared distance to the centre line [1/m^2].
        control_change: ``R`` of (95), on the change between two iterations [s^2/rad^2]. It
            vanishes at a fixed point: a proximal term, not a control cost.
        control_effort: On the squared wheel speeds [s^2/rad^2].
        control_rate: On the squared change of wheel speeds from one period to the next
            [s^2/rad^2].
    """

    road_center: float = 15.0
    control_change: float = 1.0
    control_effort: float = 0.0
    control_rate: float = 0.0


UNLIMITED: Final = 1 << 58
"""A limit of work that is never reached."""


@dataclass(frozen=True)
class SolverSettings:
    """How the C-MPSP iteration is run at each control step.

    Attributes:
        iterations_per_step: Iterations at each control step (the paper's "iteration unfolding").
        initial_iterations: Iterations where there is no plan to go on with, and the robot stands.
            Where several plans are compared, each has the first `SCREENING` of them, and the one
            that is followed has them all.
        candidates: How many plans are compared at a control step; as many again may turn first.
        qp: Name of the QP back end.
        hessian: Hessian of the cost: Gauss-Newton, exact as it is, or exact and projected to PSD.
        heading_trust_region: Largest predicted heading change of any stage in one iteration [rad];
            0 means none.
        work_rate: Stages that the computer's solver visits in a second [1/s].
        work_share: Fraction of a control period that may be spent on solving; 0 means no limit.
    """

    iterations_per_step: int = 2
    initial_iterations: int = 36
    candidates: int = 4
    qp: str = 'riccati_active_set'
    hessian: Literal['gauss_newton', 'projected', 'exact'] = 'gauss_newton'
    heading_trust_region: float = 0.6
    work_rate: float = 6e7
    work_share: float = 0.04

    def work_limit(self, period: float) -> int:
        """Work that a control step may do, in visits of a stage.

        It is counted, not timed: a replay does just as much.

        Args:
            period: Control period [s].
        """
        return int(self.work_share * self.work_rate * period) or UNLIMITED


@dataclass(frozen=True)
class InitialGuess:
    """Where the first control history comes from.

    Attributes:
        type: ``road`` follows the centre line from wherever the robot stands, ``constant`` holds
            ``wheel_speeds``.
        wheel_speeds: Right and left wheel [rad/s], used by ``constant`` only.
    """

    type: Literal['road', 'constant'] = 'road'
    wheel_speeds: tuple[float, float] = (45.13, 44.63)


@dataclass(frozen=True)
class Safety:
    """What the path must keep clear of, and where.

    Attributes:
        margin: Kept from every obstacle and road edge beside the robot's own radius [m].
        between_samples: Whether the path between two control steps must be clear as well.
    """

    margin: float = 0.0
    between_samples: bool = True


@dataclass(frozen=True)
class MovingObstacles:
    """What is made of obstacles that are told of while the robot drives.

    Attributes:
        capacity: How many of them a plan can miss at a time; 0 where none are listened to.
        timeout: Age at which one that is not told of again is forgotten [s].
        growth: Of their radii with the age of what is known of them [m/s].
        others: Namespaces of other robots, whose plans are listened to.
        others_radius: Of the footprint of each of them [m].
    """

    capacity: int = 0
    timeout: float = 1.0
    growth: float = 0.05
    others: tuple[str, ...] = ()
    others_radius: float = 0.0

    @property
    def room(self) -> int:
        """For how many a plan has constraints, other robots included."""
        return self.capacity + len(self.others)


@dataclass(frozen=True)
class GuidanceSettings:
    """All that the guidance law depends on, apart from odometry.

    Attributes:
        robot: Wheel radius, half track and wheel-speed limit.
        road: The road to stay inside.
        goal: Point to pass at the final time (x, y) [m].
        goal_tolerance: Miss up to which the goal counts as reached [m].
        goal_heading: Heading to pass it with [rad]; None for any.
        heading_tolerance: Difference from that up to which the heading counts as met [rad].
        final_time: Time at which to pass the goal, from the first odometry [s]. Where a road is
            followed it is when to stop, infinite for never.
        waypoints: What to pass before it, by increasing times.
        hold: Whether the robot is kept at the goal after the final time.
        drives_on: Whether another goal comes after this one, where it is one of several.
        nominal_speed: Speed along the road to a goal that is told without a time; 0 for eight
            tenths of the top speed, or 1 m/s without a wheel limit [m/s].
        follow: How to follow the road, where that is the task; there is no goal then.
        control_period: Time between two control steps [s].
        command_delay: Time from the stamp of odometry to the effect of the command that answers
            it [s].
        obstacles: Obstacles to miss that stand still.
        moving_obstacles: What is made of those that move.
        robot_radius: Radius of the robot's footprint, kept from obstacles and road edges [m].
        frame_id: Frame of odometry, road, obstacles and goal.
        odom_timeout: Age at which odometry counts as lost [s].
        max_slip: Largest wheel slip, a fraction, that is estimated and reckoned with; 0 for none.
        slip: Wheel slip that plans reckon with; the law follows its estimate with it.
        start_tolerance: How far from the road, or from `start_pose`, a run may begin [m].
        start_pose: Where a run is to begin [m, m, rad]; its place counts. None for the road.
        failure_tolerance: Failed control steps in a row after which the warm start is dropped.
    """

    robot: DifferentialDrive
    road: Road
    goal: tuple[float, float]
    goal_tolerance: float = 0.01
    goal_heading: float | None = None
    heading_tolerance: float = 0.01
    final_time: float = 10.0
    waypoints: tuple[Goal, ...] = ()
    hold: bool = False
    drives_on: bool = False
    nominal_speed: float = 0.0
    follow: Follow | None = None
    control_period: float = 0.2
    command_delay: float = 0.0
    obstacles: tuple[Shape, ...] = ()
    moving_obstacles: MovingObstacles = field(default_factory=MovingObstacles)
    robot_radius: float = 0.0
    weights: Weights = field(default_factory=Weights)
    solver: SolverSettings = field(default_factory=SolverSettings)
    initial_guess: InitialGuess = field(default_factory=InitialGuess)
    safety: Safety = field(default_factory=Safety)
    frame_id: str = 'odom'
    odom_timeout: float = 0.5
    failure_tolerance: int = 3
    max_slip: float = 0.0
    slip: float = 0.0
    start_tolerance: float = 0.5
    start_pose: tuple[float, float, float] | None = None

    @property
    def model(self) -> DifferentialDrive:
        """The robot as plans foresee it: it comes less far for its slip."""
        if self.slip == 0.0:
            return self.robot
        return replace(self.robot, wheel_radius=(1.0 - self.slip) * self.robot.wheel_radius)

    @property
    def goals(self) -> tuple[Goal, ...]:
        """All goals, in the order in which they are passed; none where a road is followed."""
        if self.follow is not None:
            return ()
        name = GOAL if self.waypoints else ''
        return (*self.waypoints, Goal(self.goal, self.final_time, self.goal_heading, name))

    @property
    def pace(self) -> float:
        """Speed along the road where no time says it [m/s]."""
        top = self.robot.max_speed
        return self.nominal_speed or (_PART_OF_TOP * top if math.isfinite(top) else _WITHOUT_TOP)

    def towards(
        self, goal: Goal, begin: float = 0.0, *, drives_on: bool = False
    ) -> GuidanceSettings:
        """The same with one goal alone.

        Args:
            goal: The goal.
            begin: When the way to it begins [s].
            drives_on: Whether another goal comes after it.
        """
        return replace(
            self,
            goal=goal.position,
            goal_heading=goal.heading,
            final_time=goal.time - begin,
            waypoints=(),
            drives_on=drives_on,
        )

    def miss(self, pose: Array) -> float:
        """How far a pose (x, y, ...) [m] is from the goal [m].

        Where a road is followed the goal is a line across it.
        """
        x: float
        y: float
        x, y = pose.tolist()[:2]
        if self.follow is None or self.goal_heading is None:
            return math.dist((x, y), self.goal)
        dx, dy = x - self.goal[0], y - self.goal[1]
        return abs(math.cos(self.goal_heading) * dx + math.sin(self.goal_heading) * dy)

    def heading_miss(self, pose: Array) -> float | None:
        """How far a pose's heading is from the goal's [rad]; None where any will do."""
        if self.goal_heading is None or self.follow is not None:
            return None
        return abs(math.remainder(float(pose[2]) - self.goal_heading, math.tau))

    @property
    def annulus(self) -> Annulus:
        """The road, for what is about roads between two circles only.

        Raises:
            ValueError: It is another.
        """
        if not isinstance(self.road, Annulus):
            found = type(self.road).__name__.lower()
            raise ValueError(f'road.type: found {found}, wanted annulus')  # noqa: TRY004
        return self.road
