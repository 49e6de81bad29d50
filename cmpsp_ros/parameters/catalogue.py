"""Every parameter of the two nodes: the single source for declaration, documentation and schema."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from cmpsp_ros.parameters.parameter import REQUIRED, Group, Parameter, ParameterType, Range
from cmpsp_ros.parameters.robots.models import robot_parameters
from cmpsp_ros.parameters.simulator_catalogue import simulator_parameters
from cmpsp_ros.parameters.table import ParameterTable

_BOOL, _INTEGER, _DOUBLE = ParameterType.BOOL, ParameterType.INTEGER, ParameterType.DOUBLE
_STRING, _DOUBLES = ParameterType.STRING, ParameterType.DOUBLE_ARRAY
_STRINGS = ParameterType.STRING_ARRAY

_POSITIVE: Final = Range(low=0.0, low_open=True)
_NOT_NEGATIVE: Final = Range(low=0.0)

_FIXED: Final = {'reconfigurable': False}
_POINT: Final = {'length': 2}


# fmt: off
def _parameters() -> Iterator[Parameter]:
    guidance_only = {'nodes': ('guidance',)}

    task = Group('Task', 'guidance', 'sim')
    yield task('frame_id', _STRING, 'odom', '',
        'Frame of road, obstacles, goals and odometry. Messages in another frame are transformed '
        'with `/tf`.',
        **_FIXED)
    yield task('robot_frame', _STRING, '', '',
        "Frame of the robot's centre, midway between its wheels, if odometry is that of another "
        'point: transformed with `/tf`. Empty: the child frame of odometry.',
        **_FIXED, **guidance_only)
    yield task('control_period', _DOUBLE, 0.2, 's',
        'Time between two control steps; 0.2 s in the paper.',
        range=Range(0.01, 10.0), **_FIXED)
    yield task('command_delay', _DOUBLE, 0.0, 's',
        'Time from the stamp of an odometry message until the command based on it takes effect; '
        'plans start at the pose predicted for that time.', range=_NOT_NEGATIVE, **guidance_only)
    yield task('max_command_delay', _DOUBLE, 0.0, 's',
        'Longest time until a command takes effect, as on a computer that is sometimes late. The '
        'previous command must be clear of everything until then, and is slowed down where it is '
        'not. 0: `command_delay`, and longer after commands have been late.',
        range=_NOT_NEGATIVE, **guidance_only)
    yield task('command_delay_tolerance', _DOUBLE, 0.1, 's',
        'How far `command_delay` may be wrong, either way. Where odometry contradicts its '
        'predictions, the delay that explains it is estimated within that and used instead. '
        '0: not corrected.', range=Range(0.0, 0.5), **guidance_only)
    yield task('max_wheel_lag', _DOUBLE, 0.0, 's',
        "Largest time constant of the wheels' response, apart from `command_delay`. It is "
        'estimated from odometry and compensated. Each command, and a stop after it, must be '
        'clear by a fifth of `safety.margin` with the largest lag still possible and two smaller '
        'ones; otherwise it is slowed down. 0: lag is not considered.',
        range=_NOT_NEGATIVE, **guidance_only)
    yield task('max_wheel_slip', _DOUBLE, 0.0, '',
        'Maximum wheel-slip ratio that is estimated from odometry and compensated; 0: slip is not '
        'estimated.', range=Range(0.0, 0.5), **guidance_only)
    yield task('final_time', _DOUBLE, 10.0, 's',
        'Time at which to pass the goal, counted from the first odometry; 10 s in the paper. With '
        '`follow.speed`: time at which to stop; 0: never.', range=_NOT_NEGATIVE, **_FIXED)
    yield task('start.tolerance', _DOUBLE, 0.5, 'm',
        'Maximum distance from the road, or from `start.pose`, at which a run begins. Farther '
        'away the robot is not moved, and the reason says so.',
        range=_NOT_NEGATIVE, **guidance_only)
    yield task('start.pose', _DOUBLES, [], 'm, m, rad',
        'Pose at which a run should begin (x, y, heading); only the position is checked. Empty: '
        'anywhere on the road.', **guidance_only)
    yield task('goal.position', _DOUBLES, [10.0, 0.0], 'm',
        'Point to pass at the final time (x, y); as in the paper.', **_POINT, **guidance_only)
    yield task('goal.tolerance', _DOUBLE, 0.01, 'm',
        'Distance from a goal at which it counts as reached.', range=_POSITIVE, **guidance_only)
    yield task('goal.heading', _DOUBLES, [], 'rad',
        'Heading at the goal: one number, or empty for any.', **guidance_only)
    yield task('goal.heading_tolerance', _DOUBLE, 0.01, 'rad',
        'Deviation from a given heading at which it counts as reached.',
        range=_POSITIVE, **guidance_only)
    yield task('goal.may_be_late', _BOOL, False, '',
        'Whether the final time is put off where the path to the goal proves longer than the time '
        'that is left; else the robot stops at the final time.', **guidance_only)
    yield task('goal.hold', _BOOL, False, '',
        'Whether the robot returns to the goal when it is moved away after arrival; otherwise it '
        'stays stopped.', **guidance_only)
    yield task('goal.wait', _BOOL, False, '',
        'Whether the robot waits until a goal is received, instead of driving to `goal.position`.',
        **_FIXED, **guidance_only)
    yield task('goal.nominal_speed', _DOUBLE, 0.0, 'm/s',
        'Mean speed along the road to a goal received on `goal_pose`, which has no arrival time; '
        '0: 80 % of the top speed, or 1 m/s without a wheel limit.',
        range=_NOT_NEGATIVE, **guidance_only)
    yield task('waypoints.names', _STRINGS, [], '',
        'Names of points to pass before the goal, in order of time, each with its own block; omit '
        'it if there are none.', **_FIXED, **guidance_only)
    yield task('waypoints.<name>.position', _DOUBLES, REQUIRED, 'm',
        'Position of this waypoint (x, y).', **_POINT, **guidance_only)
    yield task('waypoints.<name>.time', _DOUBLE, REQUIRED, 's',
        'Time at which to pass it, counted from the first odometry.',
        range=_POSITIVE, **_FIXED, **guidance_only)
    yield task('waypoints.<name>.heading', _DOUBLES, [], 'rad',
        'Heading at this waypoint: one number, or empty for any.', **guidance_only)
    yield task('follow.speed', _DOUBLE, 0.0, 'm/s',
        'Mean speed at which to follow a closed road instead of driving to a goal; negative: '
        'against its direction; 0: drive to the goal.', **_FIXED, **guidance_only)
    yield task('follow.horizon', _DOUBLE, 5.0, 's',
        'Planning horizon while following a road.', range=_POSITIVE, **_FIXED, **guidance_only)

    yield from robot_parameters()

    place = Group('Road and obstacles', 'guidance', 'sim')
    yield place('road.type', _STRING, 'annulus', '',
        'Shape of the road: `annulus` lies between two circles, as in the paper; `corridor` runs '
        'along a line through points; `none` is open floor.',
        choices=('annulus', 'corridor', 'none'), **_FIXED)
    yield place('road.source', _STRING, 'parameters', '',
        'Source of a `corridor`: these parameters, or the topic `road`. With `topic` the guidance '
        'node waits for a message; each message sets `road.points` and `road.closed`. The '
        'simulator publishes their initial values there.',
        choices=('parameters', 'topic'), **_FIXED)
    yield place('road.center', _DOUBLES, [0.0, 0.0], 'm',
        'Centre of an `annulus` (x, y).', **_POINT)
    yield place('road.inner_radius', _DOUBLE, 9.0, 'm',
        'Radius of the inner edge: `r_i` = 9 m in the paper.', range=_NOT_NEGATIVE)
    yield place('road.outer_radius', _DOUBLE, 11.0, 'm',
        'Radius of the outer edge: `r_o` = 11 m in the paper.', range=_POSITIVE)
    yield place('road.points', _DOUBLES, [], 'm',
        'Centre line of a `corridor`: x and y of each point, in order. `road.file` reads them '
        'from a file.')
    yield place('road.half_width', _DOUBLES, [1.0], 'm',
        'Distance from the centre line of a `corridor` to either edge: one value, or one for each '
        'point.', range=_POSITIVE)
    yield place('road.left_width', _DOUBLES, [], 'm',
        'Distance to the left edge; omit it if `road.half_width` holds.', range=_POSITIVE)
    yield place('road.right_width', _DOUBLES, [], 'm',
        'Distance to the right edge; omit it if `road.half_width` holds.', range=_POSITIVE)
    yield place('road.closed', _BOOL, False, '',
        'Whether the last point of a `corridor` is joined to its first.')
    yield place('obstacles.names', _STRINGS, [], '',
        'Names of the obstacles, each with its own block; omit it if there are none.')
    yield place('obstacles.<name>.type', _STRING, 'circle', '',
        'Shape of this obstacle: a `capsule` is the region around a line segment, a `polygon` is '
        'convex.', choices=('circle', 'capsule', 'polygon'))
    yield place('obstacles.<name>.center', _DOUBLES, [], 'm',
        'Centre of this `circle` (x, y).')
    yield place('obstacles.<name>.start', _DOUBLES, [], 'm',
        'One end of the line segment of this `capsule` (x, y).')
    yield place('obstacles.<name>.end', _DOUBLES, [], 'm', 'Other end of the line segment (x, y).')
    yield place('obstacles.<name>.vertices', _DOUBLES, [], 'm',
        'Corners of this `polygon`, in order, in either direction: x and y of each.')
    yield place('obstacles.<name>.radius', _DOUBLE, 0.0, 'm',
        'Radius of this `circle` or `capsule`; must be above 0 for these.', range=_NOT_NEGATIVE)

    yield place('map.cells', _STRING, 'none', '',
        'Cells of an occupancy grid (rows, columns, compressed values); all occupied cells form '
        'one obstacle. `map.file` reads them from a file of map_server, `map.topic` from messages.')
    yield place('map.origin', _DOUBLES, [0.0, 0.0, 0.0], 'm, m, rad',
        'Pose of the outer corner of its first cell (x, y, yaw).', length=3)
    yield place('map.resolution', _DOUBLE, 0.05, 'm', 'Side length of its cells.',
        range=_POSITIVE)
    yield place('map.unknown_is_free', _BOOL, False, '',
        'Whether unknown cells, and everything beyond the grid, are free; otherwise they are '
        'occupied.',
        **_FIXED)
    only_guidance = {'nodes': ('guidance',), **_FIXED}
    yield place('map.topic', _STRING, '', '',
        'Topic of a map or a live costmap; the guidance node waits for the first message, and each '
        'replaces the map. Empty: none.', **only_guidance)
    yield place('map.lethal', _INTEGER, 65, '',
        'Value from which on a cell in a message is occupied.', range=Range(1, 100),
        **only_guidance)
    yield place('map.timeout', _DOUBLE, 0.0, 's',
        'Age of the last message at which a live costmap counts as lost and the robot is stopped; '
        '0: a map may be of any age.', range=_NOT_NEGATIVE, **only_guidance)

    moving = Group('Moving obstacles', 'guidance')
    yield moving('moving_obstacles.capacity', _INTEGER, 0, '',
        'Maximum number of moving obstacles considered; they arrive on `moving_obstacles`. 0: the '
        'topic is not subscribed to.', range=Range(0, 64), **_FIXED)
    yield moving('moving_obstacles.timeout', _DOUBLE, 1.0, 's',
        'Age at which an obstacle that is not seen again is dropped.', range=_POSITIVE)
    yield moving('moving_obstacles.growth', _DOUBLE, 0.05, 'm/s',
        "Growth rate of an obstacle's predicted radius since it was last seen.",
        range=_NOT_NEGATIVE)
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
        'Radius of this obstacle.', range=_POSITIVE, **sim_only)

    sight = Group('Sensors', 'guidance')
    yield sight('sensors.names', _STRINGS, [], '',
        'Names of sensors that see obstacles, each with its own block; omit it if there are none.',
        **_FIXED)
    yield sight('sensors.<name>.type', _STRING, 'scan', '',
        'Messages of this sensor: `scan` for LaserScan, `cloud` for PointCloud2.',
        choices=('scan', 'cloud'), **_FIXED)
    yield sight('sensors.<name>.topic', _STRING, 'scan', '',
        'Topic of this sensor.', **_FIXED)
    yield sight('sensors.<name>.frame_id', _STRING, 'base_scan', '',
        'Frame of its messages; others are refused.', **_FIXED)
    yield sight('sensors.<name>.pose', _DOUBLES, [0.0, 0.0, 0.0], 'm, m, rad',
        'Pose of this sensor on the robot (x, y, heading).', length=3, **_FIXED)
    yield sight('sensors.<name>.reach', _DOUBLE, 8.0, 'm',
        'Distance from this sensor beyond which its measurements are ignored.',
        range=_POSITIVE, **_FIXED)
    yield sight('sensors.<name>.heights', _DOUBLES, [-1e3, 1e3], 'm',
        'Least and greatest z of the points of a `cloud` that are obstacles, in its frame.',
        **_POINT, **_FIXED)
    yield sight('sight.size', _DOUBLE, 10.0, 'm',
        'Side of the square grid around the robot in which obstacles are remembered.',
        range=Range(1.0, 100.0), **_FIXED)
    yield sight('sight.resolution', _DOUBLE, 0.05, 'm',
        'Side length of its cells.', range=Range(0.01, 1.0), **_FIXED)
    yield sight('sight.memory', _DOUBLE, 10.0, 's',
        'Time for which cells out of sight are remembered.', range=_NOT_NEGATIVE, **_FIXED)
    yield sight('sight.timeout', _DOUBLE, 0.5, 's',
        "Age of a sensor's last message at which the sensor counts as lost and the robot is "
        'stopped.',
        range=_POSITIVE, **_FIXED)

    others = Group('Other robots', 'guidance')
    yield others('others.namespaces', _STRINGS, [], '',
        'Namespaces of other robots, as in `[/r1, /r2]`. Their plans on '
        "`<namespace>/guidance/predicted_path` are avoided like moving obstacles. The robot's own "
        'namespace is ignored, so all robots can share one list; omit it if there are none.',
        **_FIXED)
    yield others('others.radius', _DOUBLE, 0.0, 'm',
        'Radius of the footprint of each of these robots.', range=_NOT_NEGATIVE)

    cost = Group('Cost', 'guidance')
    yield cost('weights.road_center', _DOUBLE, 15.0, '1/m^2',
        'Weight on the squared distance to the centre line: `q` = 15 in the paper.',
        range=_NOT_NEGATIVE)
    yield cost('weights.control_change', _DOUBLE, 1.0, 's^2/rad^2',
        'Weight on the change of wheel speeds between two iterations: `R` = I in the paper.',
        range=_POSITIVE)
    yield cost('weights.control_effort', _DOUBLE, 0.0, 's^2/rad^2',
        'Weight on the squared wheel speeds; not in the paper.', range=_NOT_NEGATIVE)
    yield cost('weights.control_rate', _DOUBLE, 0.0, 's^2/rad^2',
        'Weight on the squared change of wheel speeds between control steps; not in the paper. A '
        'value above 0 compiles its own kernels.', range=_NOT_NEGATIVE, **_FIXED)

    solver = Group('Solver', 'guidance')
    yield solver('solver.iterations_per_step', _INTEGER, 2, '',
        'Iterations at each control step, warm-started from the previous step.',
        range=Range(1, 100))
    yield solver('solver.initial_iterations', _INTEGER, 36, '',
        'Iterations at the first control step, before the robot moves: every candidate gets six, '
        'the selected one gets the rest. The paper uses as many as at any other step.',
        range=Range(1, 100))
    yield solver('solver.candidates', _INTEGER, 4, '',
        'Maximum number of candidate plans compared at a control step, one for each homotopy '
        'class. If none is feasible for a robot at rest, as many again that first turn on the '
        'spot are tried. 1: a single plan, as in the paper.',
        range=Range(1, 8))
    yield solver('solver.qp', _STRING, 'riccati_active_set', '',
        'Back end that solves the quadratic programs.', **_FIXED)
    yield solver('solver.hessian', _STRING, 'gauss_newton', '',
        'Hessian of the cost: `gauss_newton`, `exact`, which may be indefinite, or `projected`, '
        'its positive semidefinite part.',
        choices=('gauss_newton', 'projected', 'exact'))
    yield solver('solver.work_rate', _DOUBLE, 4e7, '1/s',
        'Stages that the solver visits per second on this computer; `cmpsp warmup` measures it.',
        range=_POSITIVE)
    yield solver('solver.work_share', _DOUBLE, 0.04, '',
        'Fraction of a control period that a control step may spend on solving, four times as '
        'much before the robot moves; 0: no limit. The current plan is improved first. Work is '
        'counted, not timed, so a replay decides the same.', range=Range(0.0, 1.0))
    yield solver('solver.heading_trust_region', _DOUBLE, 0.6, 'rad',
        'Maximum change of heading at any stage in one iteration; 0: no limit.',
        range=_NOT_NEGATIVE)
    yield solver('initial_guess.type', _STRING, 'road', '',
        'First control history: `road` follows the centre line, `constant` holds '
        '`initial_guess.wheel_speeds`.', choices=('road', 'constant'))
    yield solver('initial_guess.wheel_speeds', _DOUBLES, [45.13, 44.63], 'rad/s',
        'Wheel speeds (right, left) of the `constant` guess.', **_POINT)

    safety = Group('Safety', 'guidance')
    yield safety('safety.margin', _DOUBLE, 0.0, 'm',
        "Clearance from obstacles and road edges, beyond the robot's own radius.",
        range=_NOT_NEGATIVE)
    yield safety('safety.between_samples', _BOOL, True, '',
        'Whether the path must also be clear between control steps.')
    yield safety('safety.stopping_time', _DOUBLE, 0.5, 's',
        'Delay of a stop, in addition to the modelled one, that is assumed where no plan passes '
        'an obstacle: the robot approaches it slowly enough to stop before it.',
        range=_NOT_NEGATIVE)
    yield safety('safety.max_prediction_error', _DOUBLE, 0.5, 'm',
        'Distance of odometry from its prediction one control step before at which the robot '
        'stops. 0: predictions are not checked, and the response is not corrected.',
        range=_NOT_NEGATIVE)
    yield safety('safety.stop_within_sight', _BOOL, True, '',
        'Whether a robot with sensors drives slowly enough to stop before space that they have '
        'not seen.')
    yield safety('safety.max_odom_jump', _DOUBLE, 0.1, 'm',
        'Distance by which the position may differ between two odometry messages, beyond the '
        'distance that the wheels allow, with a quarter more than their limit; and twice as many '
        'radians for the heading. After a larger jump the robot stops until odometry was '
        'consistent for a control period. 0, or without a limit of the wheels: not checked.',
        range=_NOT_NEGATIVE)
    yield safety('odom_timeout', _DOUBLE, 0.5, 's',
        'Age at which odometry counts as lost and the robot is stopped.', range=_POSITIVE)
    yield safety('failure_tolerance', _INTEGER, 3, '',
        'Consecutive failed control steps after which the warm start is discarded.',
        range=Range(low=1))

    node = Group('Node', 'guidance', 'sim')
    yield node('enable_stamped_cmd_vel', _BOOL, False, '',
        'Whether velocity commands are TwistStamped instead of Twist.', **_FIXED)
    yield node('autostart', _BOOL, False, '',
        'Whether the guidance node configures and activates itself; without a course it does not '
        'become active.', **_FIXED, **guidance_only)

    yield node('recorder_timeout', _DOUBLE, 0.0, 's',
        'Time to wait for a recorder before a run begins; 0: do not wait.',
        range=_NOT_NEGATIVE, **_FIXED, **guidance_only)
    yield node('stop_with_process', _INTEGER, 0, '',
        'Process id, for example of `ros2 launch`. When that process ends, the robot is stopped '
        'and the node exits; 0: none. Recorder and viewer have this parameter, too.',
        range=_NOT_NEGATIVE, **_FIXED)

    realtime = Group('Real time', 'guidance')
    yield realtime('realtime.priority', _INTEGER, 0, '',
        'SCHED_FIFO priority of the control thread while the node is active; 0: ordinary '
        'scheduling.', range=Range(0, 99), **_FIXED)
    yield realtime('realtime.cpu', _INTEGER, -1, '',
        'Core that the control thread is bound to while the node is active; -1: any.',
        range=Range(low=-1), **_FIXED)

    yield from simulator_parameters()
# fmt: on


TABLE: Final = ParameterTable(_parameters())
"""The parameters of both nodes, in the order of the documentation."""
