"""Every parameter of the two nodes: the single source for declaration, documentation and schema."""

from collections.abc import Iterator
from typing import Final

from cmpsp_ros import guidance, simulator
from cmpsp_ros.parameters.obstacles import map_parameters, shape_parameters
from cmpsp_ros.parameters.parameter import REQUIRED, Group, Parameter, ParameterType
from cmpsp_ros.parameters.roads import road_parameters
from cmpsp_ros.parameters.table import ParameterTable
from cmpsp_ros.sensing import Sensor, SightSettings, TrackSource
from cmpsp_ros.setting import NOT_NEGATIVE, POSITIVE, Range, settings_of

_BOOL, _INTEGER, _DOUBLE, _STRING, _DOUBLES, _STRINGS = ParameterType
_FIXED: Final = {'reconfigurable': False}
_POINT: Final = {'length': 2}


# fmt: off
def _parameters() -> Iterator[Parameter]:
    guidance_only = {'nodes': ('guidance',)}
    of_task = Group('Task', 'guidance')

    task = Group('Task', 'guidance', 'sim')
    yield from task.of(guidance.TaskSettings, only=('frame_id', 'control_period'))
    yield task('robot_frame', _STRING, '', '',
        "Frame of the robot's centre, midway between its wheels, if odometry is that of another "
        'point: transformed with `/tf`. Empty: the child frame of odometry.',
        **_FIXED, **guidance_only)
    delays = 'command_delay', 'max_command_delay', 'delay_tolerance', 'max_lag', 'max_slip'
    yield from of_task.of(guidance.TaskSettings, only=delays)
    yield task('final_time', _DOUBLE, 10.0, 's',
        'Time at which to pass the goal, counted from the first odometry; 10 s in the paper. With '
        '`follow.speed`: time at which to stop; 0: never. With `goal.when` = `soonest` it does not '
        'matter.', range=NOT_NEGATIVE, **_FIXED)
    yield from of_task.of(guidance.TaskSettings, only=('start_tolerance',))
    yield task('start.pose', _DOUBLES, [], 'm, m, rad',
        'Pose at which a run should begin (x, y, heading); only the position is checked. Empty: '
        'anywhere on the road.', **guidance_only)
    yield task('goal.position', _DOUBLES, [10.0, 0.0], 'm',
        'Point to pass at the final time (x, y); as in the paper.', **_POINT, **guidance_only)
    yield task('goal.heading', _DOUBLES, [], 'rad',
        'Heading at the goal: one number, or empty for any.', **guidance_only)
    times = 'when', 'may_be_late', 'patience'
    goal = 'goal_tolerance', 'heading_tolerance', *times, 'hold', 'nominal_speed'
    yield from of_task.of(guidance.TaskSettings, only=goal)
    yield task('goal.wait', _BOOL, False, '',
        'Whether the robot waits until a goal is received, instead of driving to `goal.position`.',
        **_FIXED, **guidance_only)
    yield task('waypoints.names', _STRINGS, [], '',
        'Names of points to pass before the goal, in order of time, each with its own block; omit '
        'it if there are none.', **_FIXED, **guidance_only)
    yield task('waypoints.<name>.position', _DOUBLES, REQUIRED, 'm',
        'Position of this waypoint (x, y).', **_POINT, **guidance_only)
    yield task('waypoints.<name>.time', _DOUBLE, REQUIRED, 's',
        'Time at which to pass it, counted from the first odometry.',
        range=POSITIVE, **_FIXED, **guidance_only)
    yield task('waypoints.<name>.heading', _DOUBLES, [], 'rad',
        'Heading at this waypoint: one number, or empty for any.', **guidance_only)
    yield task('follow.speed', _DOUBLE, 0.0, 'm/s',
        'Mean speed at which to follow a closed road instead of driving to a goal; negative: '
        'against its direction; 0: drive to the goal.', **_FIXED, **guidance_only)
    yield task('follow.horizon', _DOUBLE, 5.0, 's',
        'Planning horizon while following a road.', range=POSITIVE, **_FIXED, **guidance_only)

    robot = Group('Robot', 'guidance', 'sim')
    yield robot('robot.model', _STRING, 'differential_drive', '',
        'How the robot moves: `differential_drive` on two driven wheels, `mecanum` on four, '
        '`omni_wheels` on three or more, `ackermann` steered like a car; or a class of your own, '
        '`my_package.my_module:MyRobot`.', **_FIXED)
    yield robot('robot.wheel_radius', _DOUBLE, 0.035, 'm',
        'Radius of each wheel: `r` = 35 mm in the paper.', range=POSITIVE)
    yield robot('robot.half_track', _DOUBLE, 0.055, 'm',
        "Distance from a wheel to the robot's centre: `L` = 55 mm in the paper. Of a `mecanum` "
        'robot to the side; of one on `omni_wheels` in the direction of the wheel.',
        range=POSITIVE)
    yield robot('robot.half_wheel_base', _DOUBLE, 0.0, 'm',
        "Distance from the robot's centre to a wheel of a `mecanum` robot, ahead or behind.",
        range=NOT_NEGATIVE)
    yield robot('robot.wheel_base', _DOUBLE, 0.0, 'm',
        "Distance of an `ackermann` robot's axles; odometry is that of the middle of the rear one.",
        range=NOT_NEGATIVE)
    yield robot('robot.max_steering_angle', _DOUBLE, 0.0, 'rad',
        'Limit of the steering angle of an `ackermann` robot, of one front wheel in the middle.',
        range=Range(0.0, 1.5))
    yield robot('robot.max_steering_rate', _DOUBLE, 0.0, 'rad/s',
        'Limit of its change, from one command to the next; needs `robot.max_wheel_acceleration`. '
        '0: no limit.', range=NOT_NEGATIVE, **_FIXED, **guidance_only)
    yield robot('robot.wheel_bearings', _DOUBLES, [], 'rad',
        'Directions from the centre to the `omni_wheels`, 0 ahead and counterclockwise.')
    yield robot('robot.max_wheel_speed', _DOUBLE, 51.0, 'rad/s',
        'Limit of each wheel, in both directions: 51 rad/s in the paper; 0: no limit.',
        range=NOT_NEGATIVE)
    yield robot('robot.max_wheel_acceleration', _DOUBLE, 0.0, 'rad/s^2',
        "Limit of each wheel's acceleration, from one command to the next and in a stop; the "
        'braking path must be clear, too. 0: no limit, and immediate stops. A value above 0 '
        'compiles its own kernels.',
        range=NOT_NEGATIVE, **_FIXED, **guidance_only)
    yield robot('robot.max_wheel_jerk', _DOUBLE, 0.0, 'rad/s^3',
        "Limit of the change of each wheel's acceleration, from one command to the next; needs "
        '`robot.max_wheel_acceleration`; of `differential_drive` and `ackermann` robots. Stops do '
        'not keep it. 0: no limit. A value above 0 compiles its own kernels.',
        range=NOT_NEGATIVE, **_FIXED, **guidance_only)
    yield robot('robot.max_lateral_acceleration', _DOUBLE, 0.0, 'm/s^2',
        'Limit of speed times turn rate: a car that does not slide, a tall robot that does not '
        'tip. Commands keep it; bends are driven more slowly. 0: no limit.',
        range=NOT_NEGATIVE, **_FIXED, **guidance_only)
    yield robot('robot.radius', _DOUBLE, 0.0, 'm',
        "Radius of the robot's footprint. Obstacles are enlarged and the road is narrowed by it.",
        range=NOT_NEGATIVE)
    yield robot('robot.footprint', _STRING, '', 'm',
        'Corners of the footprint as Nav2 writes them, `"[[x1, y1], [x2, y2], ...]"`: ahead and to '
        'the left of the place that odometry is of. Five discs at most cover it. `robot.radius` '
        'does not count with it. Empty: a disc of that radius.')
    yield robot('robot.footprint_excess', _DOUBLE, 0.0, 'm',
        'Distance by which the discs may reach beyond the corners, to park or to pass where it is '
        'tight; the smaller, the more discs, and the longer a step. 0: five discs in a row at '
        'most, which reach about a quarter of the width beyond the front and the rear.',
        range=NOT_NEGATIVE)
    yield robot('robot.joint_names', _STRINGS, ['wheel_right_joint', 'wheel_left_joint'], '',
        'Names of the wheel joints in the wheel-speed message: right, left; of a `mecanum` robot '
        'front left, front right, rear right, rear left; of an `ackermann` robot that of the rear '
        'axle; else in the order of `robot.wheel_bearings`.',
        **_FIXED, **guidance_only)

    place = Group('Road and obstacles', 'guidance', 'sim')
    yield from road_parameters(place)
    yield place('obstacles.names', _STRINGS, [], '',
        'Names of the obstacles, each with its own block; omit it if there are none.')
    yield from shape_parameters(place, 'obstacles')
    yield from map_parameters(place)

    moving = Group('Moving obstacles', 'guidance')
    own = 'capacity', 'timeout', 'growth'
    yield from moving.of(guidance.MovingObstacles, 'moving_obstacles.', own)
    yield from moving.of(guidance.MovingObstacles, only=('quantile', 'max_acceleration'))
    sim_only = {'nodes': ('sim',), **_FIXED}
    yield moving('moving_obstacles.names', _STRINGS, [], '',
        'Obstacles that the simulator moves and publishes, each with its own block; omit it if '
        'there are none.', **sim_only)
    yield moving('moving_obstacles.<name>.center', _DOUBLES, REQUIRED, 'm',
        'Initial centre of this obstacle (x, y).', **_POINT, **sim_only)
    yield moving('moving_obstacles.<name>.velocity', _DOUBLES, REQUIRED, 'm/s',
        'Velocity of this obstacle (x, y), from the first command to the robot on.',
        **_POINT, **sim_only)
    yield moving('moving_obstacles.<name>.radius', _DOUBLE, REQUIRED, 'm',
        'Radius of this obstacle.', range=POSITIVE, **sim_only)

    trackers = Group('Trackers', 'guidance')
    yield trackers('trackers.names', _STRINGS, [], '',
        'Names of other sources of moving obstacles, each with its own block; omit it if there are '
        'none.', **_FIXED)
    yield from trackers.of(TrackSource, 'trackers.<name>.')

    sight = Group('Sensors', 'guidance')
    yield sight('sensors.names', _STRINGS, [], '',
        'Names of sensors that see obstacles, each with its own block; omit it if there are none.',
        **_FIXED)
    yield from sight.of(Sensor, 'sensors.<name>.')
    yield from sight.of(SightSettings, 'sight.')
    others = 'others', 'others_radius'
    yield from Group('Other robots', 'guidance').of(guidance.MovingObstacles, only=others)
    yield from Group('Cost', 'guidance').of(guidance.Weights, 'weights.')
    solver = Group('Solver', 'guidance')
    yield from solver.of(guidance.SolverSettings, 'solver.')
    yield from solver.of(guidance.InitialGuess, 'initial_guess.')
    safety = Group('Safety', 'guidance')
    yield from safety.of(guidance.Safety, 'safety.')
    yield from safety.of(guidance.MovingObstacles, only=('max_speed',))
    yield from safety.of(guidance.TaskSettings, only=('odom_timeout', 'failure_tolerance'))

    node = Group('Node', 'guidance', 'sim')
    yield node('enable_stamped_cmd_vel', _BOOL, False, '',
        'Whether velocity commands are TwistStamped instead of Twist.', **_FIXED)
    yield node('autostart', _BOOL, False, '',
        'Whether the guidance node configures and activates itself; without a course it does not '
        'become active.', **_FIXED, **guidance_only)

    yield node('recorder_timeout', _DOUBLE, 0.0, 's',
        'Time to wait for a recorder before a run begins; 0: do not wait.',
        range=NOT_NEGATIVE, **_FIXED, **guidance_only)
    yield node('stop_with_process', _INTEGER, 0, '',
        'Process id, for example of `ros2 launch`. When that process ends, the robot is stopped '
        'and the node exits; 0: none. Recorder and viewer have this parameter, too.',
        range=NOT_NEGATIVE, **_FIXED)

    realtime = Group('Real time', 'guidance')
    yield realtime('realtime.priority', _INTEGER, 0, '',
        'SCHED_FIFO priority of the control thread while the node is active; 0: ordinary '
        'scheduling.', range=Range(0, 99), **_FIXED)
    yield realtime('realtime.cpu', _INTEGER, -1, '',
        'Core that the control thread is bound to while the node is active; -1: any.',
        range=Range(low=-1), **_FIXED)

    sim = Group('Simulator', 'sim')
    own = 'initial_pose', 'odom_rate', 'odom_jitter'
    yield from sim.of(simulator.PlantSettings, only=own)
    yield sim('clock_offset', _DOUBLE, 0.0, 's',
        'Time by which the clock of the robot, in all stamps of the simulator, is ahead of the '
        'ROS time of the other nodes.', range=Range(-3600.0, 3600.0), **_FIXED)
    yield from sim.of(simulator.PlantSettings, only=('cmd_vel_timeout',), nodes=('guidance', 'sim'))
    yield sim('real_time_factor', _DOUBLE, 1.0, '',
        'Simulated seconds per second of wall time.', range=POSITIVE, **_FIXED)
    yield sim('publish_clock', _BOOL, False, '',
        'Whether simulated time is published on `/clock`, for nodes with `use_sim_time`.',
        **_FIXED)
    yield sim('lockstep', _BOOL, False, '',
        'Whether simulated time waits for the command of every control step; needs '
        '`publish_clock`, and `use_sim_time` in the other nodes.', **_FIXED)
    yield sim('lockstep_timeout', _DOUBLE, 10.0, 's',
        'Wall time to wait in lockstep for a command before an error is reported, and for a '
        'subscriber that is behind.',
        range=POSITIVE)

    plant = Group('Disturbances of the simulator', 'sim')
    rest = settings_of(simulator.PlantSettings).keys() - {*own, 'cmd_vel_timeout', 'seed'}
    yield from plant.of(simulator.PlantSettings, only=rest)
    yield from plant.of(simulator.OdometryErrors, 'noise.')
    yield plant('noise.dropout_windows', _DOUBLES, [], 's',
        'Intervals in which all odometry is lost: begin and end of each, in order, counted from '
        'the start of the simulator or its last reset; omit it if there are none.',
        range=NOT_NEGATIVE, **_FIXED)
    yield from plant.of(simulator.PlantSettings, only=('seed',))

    physics = Group('Physics of the simulator', 'sim')
    yield physics('plant', _STRING, 'kinematic', '',
        'Model of the robot: exact arcs of the commanded wheel speeds, or a body with mass, '
        'motors and tyres in MuJoCo (installed separately).',
        choices=('kinematic', 'mujoco'), **_FIXED)
    yield from physics.of(simulator.Physics, 'physics.')

    scan = Group('Laser scanner of the simulator', 'sim')
    yield from scan.of(simulator.LaserSettings, 'sim.scan.')
    yield scan('sim.obstacles.names', _STRINGS, [], '',
        'Names of obstacles that only the simulator knows, each with its own block; omit it if '
        'there are none.')
    yield from shape_parameters(scan, 'sim.obstacles')

    people = Group('People in the simulator', 'sim')
    yield people('sim.people.names', _STRINGS, [], '',
        'Names of people who walk about, known to the scanner alone, or of groups; each with its '
        'own block. They begin with the first command to the robot. Omit it if there are none.',
        **_FIXED)
    yield people('sim.people.<name>.position', _DOUBLES, REQUIRED, 'm',
        'Initial position (x, y).', **_POINT, **_FIXED)
    yield from people.of(simulator.Walker, 'sim.people.<name>.')
    yield from people.of(simulator.PeopleSettings, 'sim.people.')
# fmt: on


TABLE: Final = ParameterTable(_parameters())  # of both nodes, in the order of the documentation
