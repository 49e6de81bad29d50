"""Settings of the simulated robot, its odometry, physics and laser scanner, and of people."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.setting import NOT_NEGATIVE, POSITIVE, Range, setting

if TYPE_CHECKING:
    from cmpsp_ros.robots import Robot

Vector = tuple[float, float, float]
Point = tuple[float, float]

_ANGLE = Range(-math.tau, math.tau)
_PROBABILITY = Range(0.0, 1.0)
_SPACING = 0.7  # distance between the members of a group [m]


# fmt: off
@dataclass(frozen=True)
class OdometryErrors:
    """Differences between odometry and the truth."""

    position_stddev: float = setting(0.0, 'm',
        'Standard deviation of the noise on each measured coordinate.', NOT_NEGATIVE)
    heading_stddev: float = setting(0.0, 'rad',
        'Standard deviation of the noise on the measured heading.', NOT_NEGATIVE)
    bias: Vector = setting((0.0, 0.0, 0.0), 'm, m, rad',
        'Constant error of the measured pose (x, y, heading).')
    drift: Vector = setting((0.0, 0.0, 0.0), 'm/s, m/s, rad/s',
        'Rate at which the error of the measured pose grows (x, y, heading).')
    dropout: float = setting(0.0, '',
        'Probability that an odometry message is lost.', Range(0.0, 1.0, high_open=True))
    dropout_windows: tuple[tuple[float, float], ...] = ()  # [begin, end) of lost odometry [s]


@dataclass(frozen=True)
class Physics:
    """Mass, friction, motors and odometry of a robot in MuJoCo."""

    mass: float = setting(1.0, 'kg', 'Mass of the whole robot.', POSITIVE, live=False)
    friction: float = setting(1.0, '',
        'Coefficient of sliding friction between tyres and floor.', POSITIVE, live=False)
    torque: float = setting(0.2, 'N m', 'Maximum motor torque.', POSITIVE, live=False)
    odometry: Literal['truth', 'encoders'] = setting('truth', '',
        'Source of odometry: the true pose, or dead reckoning from wheel encoders.', live=False)


@dataclass(frozen=True)
class PlantSettings:
    """Settings of the simulated robot; physics is None for exact arcs."""

    robot: Robot
    initial_pose: Vector = setting((0.0, -9.25, 0.0), 'm, m, rad',
        'Initial pose (x, y, heading); as in the paper.', live=False)
    odom_rate: float = setting(50.0, 'Hz',
        'Odometry messages per second of simulated time.',
        Range(0.0, 10000.0, low_open=True), live=False)
    odom_jitter: float = setting(0.0, 's',
        'Maximum delay of an odometry instant after its point on the time grid, uniformly '
        'distributed; less than the odometry period.', NOT_NEGATIVE, live=False)
    cmd_vel_timeout: float = setting(0.5, 's',
        'Age of the last command at which the robot stops by itself; 0: never.', NOT_NEGATIVE)
    actuation_delay: float = setting(0.0, 's',
        'Time from the arrival of a command until it takes effect.', NOT_NEGATIVE)
    actuation_jitter: float = setting(0.0, 's',
        'Maximum additional delay of a command, uniformly distributed; commands stay in order.',
        NOT_NEGATIVE)
    actuation_period: float = setting(0.0, 's',
        'Period of the controller of the robot: a command takes effect at its next cycle; '
        '0: at once.', NOT_NEGATIVE)
    wheel_lag: float = setting(0.0, 's', 'Time constant of the wheels (first order).',
        NOT_NEGATIVE)
    wheel_slip: tuple[float, float] = setting((0.0, 0.0), '',
        'Slip ratio of each wheel (right, left): the fraction of its rotation that does not move '
        'the robot.', Range(-1.0, 1.0))
    wheel_slip_stddev: float = setting(0.0, '',
        'Standard deviation of additional random slip, drawn for each wheel and command.',
        NOT_NEGATIVE)
    odometry: OdometryErrors = field(default_factory=OdometryErrors)
    seed: int = setting(0, '', 'Seed of all random numbers in the simulator.',
        NOT_NEGATIVE, live=False, key='noise.seed')
    physics: Physics | None = None


@dataclass(frozen=True)
class LaserSettings:
    """Settings of a laser scanner; ranges are reported as in REP 117."""

    rate: float = setting(0.0, 'Hz',
        'Laser scans per second of simulated time, on `scan`; 0: no scanner. It sees static and '
        'moving obstacles, and those of `sim.obstacles`.', Range(0.0, 1000.0), live=False)
    frame_id: str = setting('base_scan', '', 'Frame of the scanner.', live=False)
    pose: Vector = setting((0.0, 0.0, 0.0), 'm, m, rad',
        'Pose of the scanner on the robot (x, y, heading).', live=False)
    angle_min: float = setting(-3.14, 'rad', 'Angle of the first beam.', _ANGLE, live=False)
    angle_max: float = setting(3.14, 'rad',
        'Angle of the last beam, at most a full turn later.', _ANGLE, live=False)
    count: int = setting(360, '', 'Number of beams in a scan.', Range(2, 10000), live=False)
    time_increment: float = setting(0.0, 's',
        'Time between two beams, during which the robot moves.', NOT_NEGATIVE, live=False)
    range_min: float = setting(0.1, 'm',
        'Shortest range that is measured; anything nearer is reported as -inf.',
        NOT_NEGATIVE, live=False)
    range_max: float = setting(8.0, 'm',
        'Longest range that is measured; a beam that meets nothing within it is reported as inf.',
        POSITIVE, live=False)
    stddev: float = setting(0.0, 'm',
        'Standard deviation of the noise on each range.', NOT_NEGATIVE, live=False)
    dropout: float = setting(0.0, '',
        'Probability that a beam measures nothing, which is reported as NaN.',
        _PROBABILITY, live=False)
    missed_return: float = setting(0.0, '',
        'Probability that a beam is not reflected, as from black or shiny surfaces, which is '
        'reported as inf.', _PROBABILITY, live=False)
    road_edges: bool = setting(False, '',
        'Whether the edges of the road are walls that the scanner sees.', live=False)
    seed: int = 0

    @property
    def angles(self) -> Array:
        """Angles of all beams, shape ``(count,)`` [rad]."""
        return self.angle_min + self.angle_increment * np.arange(self.count, dtype=np.float64)

    @property
    def angle_increment(self) -> float:
        """Angle between two beams [rad]."""
        return (self.angle_max - self.angle_min) / (self.count - 1)

@dataclass(frozen=True)
class Walker:
    """A person, or a group that walks together."""

    name: str
    position: Point
    motion: Literal['straight', 'waypoints', 'random'] = setting('straight', '',
        'Path: `straight` ahead from wall to wall, `waypoints` there and back, or `random` from '
        'point to point.', live=False)
    heading: float = setting(0.0, 'rad', 'Initial direction of a `straight` path.', live=False)
    waypoints: tuple[float, ...] = setting((), 'm',
        'Points to visit after the initial position, there and back: x and y of each.', live=False)
    speed: float = setting(1.0, 'm/s', 'Walking speed.', Range(0.0, 10.0), live=False)
    radius: float = setting(0.25, 'm', 'Radius of the body.', POSITIVE, live=False)
    gives_way: bool = setting(True, '',
        'Whether this person avoids the robot and other people; otherwise brakes for people alone.',
        live=False)
    count: int = setting(1, '', 'Number of people who walk together.', Range(1, 12), live=False)

    @property
    def formation(self) -> Array:
        """Offsets of the members of a group from its first, in rows of two, ``(n, 2)`` [m]."""
        rows, columns = np.divmod(np.arange(self.count), 2)
        return np.asarray(_SPACING * np.column_stack([-rows, columns]).astype(float))

    @property
    def places(self) -> Array:
        """Initial positions of the members, ``(n, 2)`` [m]."""
        return np.asarray(self.formation + np.array(self.position))


@dataclass(frozen=True)
class PeopleSettings:
    """All people of a simulation."""

    walkers: tuple[Walker, ...] = ()
    acceleration: float = setting(0.8, 'm/s^2', 'Limit of their acceleration.', POSITIVE,
        live=False)
    legs: bool = setting(False, '',
        'Whether the scanner sees two legs of each person instead of the body.', live=False)
    seed: int = 0
# fmt: on
