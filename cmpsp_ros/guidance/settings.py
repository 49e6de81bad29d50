"""Everything the guidance law is told before it starts, as one immutable value."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from cmpsp_ros.robot.differential_drive import DifferentialDrive
from cmpsp_ros.robot.obstacles import Obstacle
from cmpsp_ros.robot.road import Annulus, Road


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


@dataclass(frozen=True)
class SolverSettings:
    """How the C-MPSP iteration is run at each control step.

    Attributes:
        iterations_per_step: Iterations at each control step (the paper's "iteration unfolding").
        initial_iterations: Iterations where there is no plan to go on with, and the robot stands.
        candidates: How many plans are compared at a control step, at most.
        qp: Name of the QP back end.
        hessian: Hessian of the cost: Gauss-Newton, exact as it is, or exact and projected to PSD.
        heading_trust_region: Largest predicted heading change of any stage in one iteration [rad];
            0 means none.
    """

    iterations_per_step: int = 2
    initial_iterations: int = 6
    candidates: int = 4
    qp: str = 'riccati_active_set'
    hessian: Literal['gauss_newton', 'projected', 'exact'] = 'gauss_newton'
    heading_trust_region: float = 0.6

    def iterations(self, *, at_rest: bool) -> int:
        """Iterations at a control step; at rest there is no plan to go on with."""
        return self.initial_iterations if at_rest else self.iterations_per_step


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
class GuidanceSettings:
    """All that the guidance law depends on, apart from odometry.

    Attributes:
        robot: Wheel radius, half track and wheel-speed limit.
        road: The road to stay inside.
        goal: Point to pass at the final time (x, y) [m].
        goal_tolerance: Miss up to which the goal counts as reached [m].
        final_time: Time at which to pass the goal, from the first odometry [s].
        control_period: Time between two control steps [s].
        command_delay: Time from the stamp of odometry to the effect of the command that answers
            it [s].
        obstacles: Obstacles to miss.
        robot_radius: Radius of the robot's footprint, kept from obstacles and road edges [m].
        frame_id: Frame of odometry, road, obstacles and goal.
        odom_timeout: Age at which odometry counts as lost [s].
        failure_tolerance: Failed control steps in a row after which the warm start is dropped.
    """

    robot: DifferentialDrive
    road: Road
    goal: tuple[float, float]
    goal_tolerance: float = 0.01
    final_time: float = 10.0
    control_period: float = 0.2
    command_delay: float = 0.0
    obstacles: tuple[Obstacle, ...] = ()
    robot_radius: float = 0.0
    weights: Weights = field(default_factory=Weights)
    solver: SolverSettings = field(default_factory=SolverSettings)
    initial_guess: InitialGuess = field(default_factory=InitialGuess)
    safety: Safety = field(default_factory=Safety)
    frame_id: str = 'odom'
    odom_timeout: float = 0.5
    failure_tolerance: int = 3

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
