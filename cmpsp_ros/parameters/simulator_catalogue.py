"""The parameters of the simulator, as rows of the table."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

from cmpsp_ros.parameters.parameter import Group, Parameter, ParameterType, Range

_BOOL, _INTEGER, _DOUBLE = ParameterType.BOOL, ParameterType.INTEGER, ParameterType.DOUBLE
_STRING, _DOUBLES = ParameterType.STRING, ParameterType.DOUBLE_ARRAY
_STRINGS = ParameterType.STRING_ARRAY

_POSITIVE: Final = Range(low=0.0, low_open=True)
_NOT_NEGATIVE: Final = Range(low=0.0)
_ANGLE: Final = Range(-math.tau, math.tau)
_PROBABILITY: Final = Range(0.0, 1.0)

_FIXED: Final = {'reconfigurable': False}


# fmt: off
def simulator_parameters() -> Iterator[Parameter]:
    """The rows, in the order of the documentation."""
    sim = Group('Simulator', 'sim')
    yield sim('initial_pose', _DOUBLES, [0.0, -9.25, 0.0], 'm, m, rad',
        'Initial pose (x, y, heading); as in the paper.', length=3, **_FIXED)
    yield sim('odom_rate', _DOUBLE, 50.0, 'Hz',
        'Odometry messages per second of simulated time.',
        range=Range(0.0, 10000.0, low_open=True), **_FIXED)
    yield sim('odom_jitter', _DOUBLE, 0.0, 's',
        'Maximum delay of an odometry instant after its point on the time grid, uniformly '
        'distributed; less than the odometry period.', range=_NOT_NEGATIVE, **_FIXED)
    yield sim('clock_offset', _DOUBLE, 0.0, 's',
        'Time by which the clock of the robot, in all stamps of the simulator, is ahead of the '
        'ROS time of the other nodes.', range=Range(-3600.0, 3600.0), **_FIXED)
    yield sim('cmd_vel_timeout', _DOUBLE, 0.5, 's',
        'Age of the last command at which the robot stops by itself; 0: never.',
        range=_NOT_NEGATIVE, nodes=('guidance', 'sim'))
    yield sim('real_time_factor', _DOUBLE, 1.0, '',
        'Simulated seconds per second of wall time.', range=_POSITIVE, **_FIXED)
    yield sim('publish_clock', _BOOL, False, '',
        'Whether simulated time is published on `/clock`, for nodes with `use_sim_time`.',
        **_FIXED)
    yield sim('lockstep', _BOOL, False, '',
        'Whether simulated time waits for the command of every control step; needs '
        '`publish_clock`, and `use_sim_time` in the other nodes.', **_FIXED)
    yield sim('lockstep_timeout', _DOUBLE, 10.0, 's',
        'Wall time to wait for a command in lockstep before an error is reported.',
        range=_POSITIVE)

    plant = Group('Disturbances of the simulator', 'sim')
    yield plant('actuation_delay', _DOUBLE, 0.0, 's',
        'Time from the arrival of a command until it takes effect.', range=_NOT_NEGATIVE)
    yield plant('actuation_jitter', _DOUBLE, 0.0, 's',
        'Maximum additional delay of a command, uniformly distributed; commands stay in order.',
        range=_NOT_NEGATIVE)
    yield plant('actuation_period', _DOUBLE, 0.0, 's',
        'Period of the controller of the robot: a command takes effect at its next cycle; '
        '0: at once.', range=_NOT_NEGATIVE)
    yield plant('wheel_lag', _DOUBLE, 0.0, 's',
        'Time constant of the wheels (first order).', range=_NOT_NEGATIVE)
    yield plant('wheel_slip', _DOUBLES, [0.0, 0.0], '',
        'Slip ratio of each wheel (right, left): the fraction of its rotation that does not move '
        'the robot.', range=Range(-1.0, 1.0), length=2)
    yield plant('wheel_slip_stddev', _DOUBLE, 0.0, '',
        'Standard deviation of additional random slip, drawn for each wheel and command.',
        range=_NOT_NEGATIVE)
    yield plant('noise.position_stddev', _DOUBLE, 0.0, 'm',
        'Standard deviation of the noise on each measured coordinate.', range=_NOT_NEGATIVE)
    yield plant('noise.heading_stddev', _DOUBLE, 0.0, 'rad',
        'Standard deviation of the noise on the measured heading.', range=_NOT_NEGATIVE)
    yield plant('noise.bias', _DOUBLES, [0.0, 0.0, 0.0], 'm, m, rad',
        'Constant error of the measured pose (x, y, heading).', length=3)
    yield plant('noise.drift', _DOUBLES, [0.0, 0.0, 0.0], 'm/s, m/s, rad/s',
        'Rate at which the error of the measured pose grows (x, y, heading).', length=3)
    yield plant('noise.dropout', _DOUBLE, 0.0, '',
        'Probability that an odometry message is lost.', range=Range(0.0, 1.0, high_open=True))
    yield plant('noise.dropout_windows', _DOUBLES, [], 's',
        'Intervals in which all odometry is lost: begin and end of each, in order, counted from '
        'the start of the simulator or its last reset; omit it if there are none.',
        range=_NOT_NEGATIVE, **_FIXED)
    yield plant('noise.seed', _INTEGER, 0, '',
        'Seed of all random numbers in the simulator.', range=_NOT_NEGATIVE, **_FIXED)

    physics = Group('Physics of the simulator', 'sim')
    yield physics('plant', _STRING, 'kinematic', '',
        'Model of the robot: exact arcs of the commanded wheel speeds, or a body with mass, '
        'motors and tyres in MuJoCo (installed separately).',
        choices=('kinematic', 'mujoco'), **_FIXED)
    yield physics('physics.mass', _DOUBLE, 1.0, 'kg',
        'Mass of the whole robot.', range=_POSITIVE, **_FIXED)
    yield physics('physics.friction', _DOUBLE, 1.0, '',
        'Coefficient of sliding friction between tyres and floor.', range=_POSITIVE, **_FIXED)
    yield physics('physics.torque', _DOUBLE, 0.2, 'N m',
        'Maximum motor torque.', range=_POSITIVE, **_FIXED)
    yield physics('physics.odometry', _STRING, 'truth', '',
        'Source of odometry: the true pose, or dead reckoning from wheel encoders.',
        choices=('truth', 'encoders'), **_FIXED)

    scan = Group('Laser scanner of the simulator', 'sim')
    yield scan('sim.scan.rate', _DOUBLE, 0.0, 'Hz',
        'Laser scans per second of simulated time, on `scan`; 0: no scanner. It sees static and '
        'moving obstacles, and those of `sim.obstacles`.', range=Range(0.0, 1000.0), **_FIXED)
    yield scan('sim.scan.frame_id', _STRING, 'base_scan', '',
        'Frame of the scanner.', **_FIXED)
    yield scan('sim.scan.pose', _DOUBLES, [0.0, 0.0, 0.0], 'm, m, rad',
        'Pose of the scanner on the robot (x, y, heading).', length=3, **_FIXED)
    yield scan('sim.scan.angle_min', _DOUBLE, -3.14, 'rad',
        'Angle of the first beam.', range=_ANGLE, **_FIXED)
    yield scan('sim.scan.angle_max', _DOUBLE, 3.14, 'rad',
        'Angle of the last beam, at most a full turn later.', range=_ANGLE, **_FIXED)
    yield scan('sim.scan.count', _INTEGER, 360, '',
        'Number of beams in a scan.', range=Range(2, 10000), **_FIXED)
    yield scan('sim.scan.time_increment', _DOUBLE, 0.0, 's',
        'Time between two beams, during which the robot moves.', range=_NOT_NEGATIVE, **_FIXED)
    yield scan('sim.scan.range_min', _DOUBLE, 0.1, 'm',
        'Shortest range that is measured; anything nearer is reported as -inf.',
        range=_NOT_NEGATIVE, **_FIXED)
    yield scan('sim.scan.range_max', _DOUBLE, 8.0, 'm',
        'Longest range that is measured; a beam that meets nothing within it is reported as inf.',
        range=_POSITIVE, **_FIXED)
    yield scan('sim.scan.stddev', _DOUBLE, 0.0, 'm',
        'Standard deviation of the noise on each range.', range=_NOT_NEGATIVE, **_FIXED)
    yield scan('sim.scan.dropout', _DOUBLE, 0.0, '',
        'Probability that a beam measures nothing, which is reported as NaN.',
        range=_PROBABILITY, **_FIXED)
    yield scan('sim.scan.missed_return', _DOUBLE, 0.0, '',
        'Probability that a beam is not reflected, as from black or shiny surfaces, which is '
        'reported as inf.', range=_PROBABILITY, **_FIXED)
    yield scan('sim.scan.road_edges', _BOOL, False, '',
        'Whether the edges of the road are walls that the scanner sees.', **_FIXED)
    yield scan('sim.obstacles.names', _STRINGS, [], '',
        'Names of obstacles that only the simulator knows, each with its own block; omit it if '
        'there are none.')
    yield scan('sim.obstacles.<name>.type', _STRING, 'circle', '',
        'Shape of this obstacle, as in `obstacles`.', choices=('circle', 'capsule', 'polygon'))
    yield scan('sim.obstacles.<name>.center', _DOUBLES, [], 'm',
        'Centre of this `circle` (x, y).')
    yield scan('sim.obstacles.<name>.start', _DOUBLES, [], 'm',
        'One end of the line segment of this `capsule` (x, y).')
    yield scan('sim.obstacles.<name>.end', _DOUBLES, [], 'm',
        'Other end of the line segment (x, y).')
    yield scan('sim.obstacles.<name>.vertices', _DOUBLES, [], 'm',
        'Corners of this `polygon`, in order: x and y of each.')
    yield scan('sim.obstacles.<name>.radius', _DOUBLE, 0.0, 'm',
        'Radius of this `circle` or `capsule`; must be above 0 for these.', range=_NOT_NEGATIVE)
# fmt: on
