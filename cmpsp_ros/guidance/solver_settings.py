"""Settings of the cost, the iteration, its initial guess, moving obstacles, safety and task."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final, Literal

from cmpsp_ros.sensing import TrackSource
from cmpsp_ros.setting import NOT_NEGATIVE, POSITIVE, Range, setting

SCREENING: Final = 6  # initial iterations after which plans are compared
UNLIMITED: Final = 1 << 58  # a limit of work that is never reached


# fmt: off
@dataclass(frozen=True)
class Weights:
    """Weights of the cost (95) and of two true control costs."""

    road_center: float = setting(15.0, '1/m^2',
        'Weight on the squared distance to the centre line: `q` = 15 in the paper.', NOT_NEGATIVE)
    # It vanishes at a fixed point: a proximal term, not a control cost.
    control_change: float = setting(1.0, 's^2/rad^2',
        'Weight on the change of wheel speeds between two iterations: `R` = I in the paper.',
        POSITIVE)
    control_effort: float = setting(0.0, 's^2/rad^2',
        'Weight on the squared wheel speeds; not in the paper.', NOT_NEGATIVE)
    control_rate: float = setting(0.0, 's^2/rad^2',
        'Weight on the squared change of wheel speeds between control steps; not in the paper. A '
        'value above 0 compiles its own kernels.', NOT_NEGATIVE, live=False)


@dataclass(frozen=True)
class SolverSettings:
    """Iterations, candidates and limits of the C-MPSP solver at each control step."""

    iterations_per_step: int = setting(2, '',
        'Iterations at each control step, warm-started from the previous step.', Range(1, 100))
    initial_iterations: int = setting(36, '',
        'Iterations at the first control step, before the robot moves: every candidate gets six, '
        'the selected one gets the rest. The paper uses as many as at any other step.',
        Range(1, 100))
    candidates: int = setting(4, '',
        'Maximum number of candidate plans compared at a control step, one for each homotopy '
        'class. If none is feasible for a robot at rest, as many again that first turn on the '
        'spot are tried. 1: a single plan, as in the paper.', Range(1, 8))
    qp: str = setting('riccati_active_set', '',
        'Back end that solves the quadratic programs.', live=False)
    hessian: Literal['gauss_newton', 'projected', 'exact'] = setting('gauss_newton', '',
        'Hessian of the cost: `gauss_newton`, `exact`, which may be indefinite, or `projected`, '
        'its positive semidefinite part.')
    work_rate: float = setting(4e7, '1/s',
        'Stages that the solver visits per second on this computer; `cmpsp warmup` measures it.',
        POSITIVE)
    work_share: float = setting(0.04, '',
        'Fraction of a control period that a control step may spend on solving, four times as '
        'much before the robot moves; 0: no limit. The current plan is improved first. Work is '
        'counted, not timed, so a replay decides the same.', Range(0.0, 1.0))
    heading_trust_region: float = setting(0.6, 'rad',
        'Maximum change of heading at any stage in one iteration; 0: no limit.', NOT_NEGATIVE)

    def work_limit(self, period: float) -> int:
        """Work limit of a control step [visits of a stage], counted so that a replay repeats it."""
        return int(self.work_share * self.work_rate * period) or UNLIMITED


@dataclass(frozen=True)
class InitialGuess:
    """Source of the first control history."""

    type: Literal['road', 'constant'] = setting('road', '',
        'First control history: `road` follows the centre line, `constant` holds '
        '`initial_guess.wheel_speeds`.')
    wheel_speeds: tuple[float, float] = setting((45.13, 44.63), 'rad/s',
        'Wheel speeds (right, left) of the `constant` guess.')


@dataclass(frozen=True)
class MovingObstacles:
    """Settings for moving obstacles and other robots."""

    capacity: int = setting(0, '',
        'Maximum number of moving obstacles considered; they arrive on `moving_obstacles`. 0: the '
        'topic is not subscribed to, and 8 that sensors or trackers see are considered.',
        Range(0, 64), live=False)
    timeout: float = setting(1.0, 's',
        'Age at which an obstacle that is not seen again is dropped.', POSITIVE)
    growth: float = setting(0.05, 'm/s',
        "Growth rate of an obstacle's predicted radius since it was last seen.", NOT_NEGATIVE)
    quantile: float = setting(2.0, '',
        'Standard deviations of the position at the next control step by which plans take an '
        'obstacle for larger than it was seen.', NOT_NEGATIVE, key='people.quantile')
    max_acceleration: float = setting(1.0, 'm/s^2',
        'Largest acceleration of a moving obstacle, in any direction. No command leads to where '
        'one could be by then, until the robot is at rest.', NOT_NEGATIVE,
        key='people.max_acceleration')
    max_speed: float = setting(1.6, 'm/s',
        'Largest speed of a moving obstacle, unless it was seen to be faster.', NOT_NEGATIVE,
        key='safety.max_obstacle_speed')
    others: tuple[str, ...] = setting((), '',
        'Namespaces of other robots, as in `[/r1, /r2]`. Their plans on '
        "`<namespace>/guidance/predicted_path` are avoided like moving obstacles. The robot's own "
        'namespace is ignored, so all robots can share one list; omit it if there are none.',
        live=False, key='others.namespaces')
    others_radius: float = setting(0.0, 'm',
        'Radius of the footprint of each of these robots.', NOT_NEGATIVE, key='others.radius')
    trackers: tuple[TrackSource, ...] = ()

    @property
    def slots(self) -> int:
        """Number of constraints a stage has for them, other robots included."""
        return self.capacity + len(self.others)


@dataclass(frozen=True)
class Safety:
    """Required clearances, and conditions to stop the robot."""

    margin: float = setting(0.0, 'm',
        "Clearance from obstacles and road edges, beyond the robot's own radius.", NOT_NEGATIVE)
    between_samples: bool = setting(True, '',
        'Whether the path must also be clear between control steps.')
    stopping_time: float = setting(0.5, 's',
        'Delay of a stop, in addition to the modelled one, that is assumed where no plan passes '
        'an obstacle: the robot approaches it slowly enough to stop before it.', NOT_NEGATIVE)
    max_prediction_error: float = setting(0.5, 'm',
        'Distance of odometry from its prediction one control step before at which the robot '
        'stops. 0: predictions are not checked, and the response is not corrected.', NOT_NEGATIVE)
    stop_within_sight: Literal['off', 'stationary', 'moving'] = setting('stationary', '',
        'Whether a robot with sensors drives slowly enough to stop before space that they have '
        'not seen: `stationary`; `moving`: also before anything could come from there at '
        '`safety.max_obstacle_speed`, though no slower than 0.1 m/s. With both, once something has '
        'been seen to move, at most 0.05 m/s into places out of sight, as backwards.')
    max_odom_jump: float = setting(0.1, 'm',
        'Distance by which the position may differ between two odometry messages, beyond the '
        'distance that the wheels allow, with a quarter more than their limit; and twice as many '
        'radians for the heading. After a larger jump the robot stops until odometry was '
        'consistent for a control period. 0, or without a limit of the wheels: not checked.',
        NOT_NEGATIVE)


@dataclass(frozen=True, kw_only=True)
class TaskSettings:
    """Times, tolerances and limits of the task."""

    frame_id: str = setting('odom', '',
        'Frame of road, obstacles, goals and odometry. Messages in another frame are transformed '
        'with `/tf`.', live=False)
    control_period: float = setting(0.2, 's',
        'Time between two control steps; 0.2 s in the paper.', Range(0.01, 10.0), live=False)
    command_delay: float = setting(0.0, 's',
        'Time from the stamp of an odometry message until the command based on it takes effect; '
        'plans start at the pose predicted for that time.', NOT_NEGATIVE)
    max_command_delay: float = setting(0.0, 's',
        'Longest time until a command takes effect, as on a computer that is sometimes late. The '
        'previous command must be clear of everything until then, and is slowed down where it is '
        'not. 0: `command_delay`, and longer after commands have been late.', NOT_NEGATIVE)
    delay_tolerance: float = setting(0.1, 's',
        'How far `command_delay` may be wrong, either way. Where odometry contradicts its '
        'predictions, the delay that explains it is estimated within that and used instead. '
        '0: not corrected.', Range(0.0, 0.5), key='command_delay_tolerance')
    max_lag: float = setting(0.0, 's',
        "Largest time constant of the wheels' response, apart from `command_delay`. It is "
        'estimated from odometry and compensated. Each command, and a stop after it, must be '
        'clear by a fifth of `safety.margin` with the largest lag still possible and two smaller '
        'ones; otherwise it is slowed down. 0: lag is not considered.', NOT_NEGATIVE,
        key='max_wheel_lag')
    max_slip: float = setting(0.0, '',
        'Maximum wheel-slip ratio that is estimated from odometry and compensated; 0: slip is not '
        'estimated.', Range(0.0, 0.5), key='max_wheel_slip')
    start_tolerance: float = setting(0.5, 'm',
        'Maximum distance from the road, or from `start.pose`, at which a run begins. Farther '
        'away the robot is not moved, and the reason says so.', NOT_NEGATIVE,
        key='start.tolerance')
    goal_tolerance: float = setting(0.01, 'm',
        'Distance from a goal at which it counts as reached.', POSITIVE, key='goal.tolerance')
    heading_tolerance: float = setting(0.01, 'rad',
        'Deviation from a given heading at which it counts as reached.', POSITIVE,
        key='goal.heading_tolerance')
    may_be_late: bool = setting(False, '',
        'Whether the final time is put off where the path to the goal proves longer than the time '
        'that is left; else the robot stops at the final time.', key='goal.may_be_late')
    when: Literal['fixed', 'soonest'] = setting('fixed', '',
        'When to pass the goal and the points before it: `fixed`, at their times; `soonest`, as '
        'early as plans find possible, regardless of `final_time` and the times of waypoints. With '
        '`robot.max_wheel_acceleration` the robot then comes to rest at the goal.', key='goal.when')
    patience: float = setting(3.0, 's',
        'Time without progress towards the goal after which the robot tries other ways, backs out '
        'and turns, each after a third as long; then it stops for good. 0: it waits.', NOT_NEGATIVE,
        key='goal.patience')
    hold: bool = setting(False, '',
        'Whether the robot returns to the goal when it is moved away after arrival; otherwise it '
        'stays stopped.', key='goal.hold')
    nominal_speed: float = setting(0.0, 'm/s',
        'Mean speed along the road to a goal received on `goal_pose`, which has no arrival time; '
        '0: 80 % of the top speed, or 1 m/s without a wheel limit.', NOT_NEGATIVE,
        key='goal.nominal_speed')
    odom_timeout: float = setting(0.5, 's',
        'Age at which odometry counts as lost and the robot is stopped.', POSITIVE)
    failure_tolerance: int = setting(3, '',
        'Consecutive failed control steps after which the warm start is discarded.', Range(low=1))
    # fmt: on

    @cached_property
    def is_soonest(self) -> bool:
        """True if goals are to be passed as early as possible."""
        return self.when == 'soonest'

    @cached_property
    def moves_final_time(self) -> bool:
        """True if the final time is not that of the settings."""
        return self.may_be_late or self.is_soonest
