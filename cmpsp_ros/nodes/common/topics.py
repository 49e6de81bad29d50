"""Topics and services of the nodes: the single source for code and doc/reference/topics.md."""

from dataclasses import replace

from diagnostic_msgs.msg import DiagnosticArray, KeyValue
from geometry_msgs.msg import PolygonStamped, PoseStamped, Twist, TwistStamped
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from rcl_interfaces.msg import ParameterEvent
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState, LaserScan, PointCloud2
from std_srvs.srv import Trigger
from visualization_msgs.msg import MarkerArray

from cmpsp_ros.guidance.messages import PeerTrajectory
from cmpsp_ros.nodes.common.topic import Topic

# Depth for topics that are recorded.
#
# In lockstep a run takes a second or two, and a recorder on a busy machine lags far behind.
OF_A_RUN = 1000

# fmt: off
GUIDANCE_ODOM = Topic('guidance', 'in', 'odom', Odometry,
    'pose in the frame `frame_id`, or in one that `/tf` connects to it; best effort, to accept '
    'every publisher', depth=50, best_effort=True)
GUIDANCE_MOVING = Topic('guidance', 'in', 'moving_obstacles', PointCloud2,
    'with `moving_obstacles.capacity`: one point per obstacle, fields `x`, `y` [m], `vx`, `vy` '
    '[m/s], `radius` [m] (floats) and `id` (integer); frame as for `odom`; best effort',
    depth=50, best_effort=True)
OTHER_PLANS = Topic('guidance', 'in', '<namespace>/guidance/predicted_path', Path,
    'for each of `others.namespaces`: the plan of another robot, each pose with its time; one '
    'pose for a robot at rest', repeats=True)
SCAN = Topic('guidance', 'in', 'scan', LaserScan,
    'for each of `sensors.names`, on `sensors.<name>.topic`: LaserScan or PointCloud2, as in '
    '`sensors.<name>.type`; best effort', depth=50, best_effort=True)
TRACKER = Topic('guidance', 'in', 'tracks', PointCloud2,
    'for each of `trackers.names`, on `trackers.<name>.topic`: what another tracker sees, of the '
    'type in `trackers.<name>.type`; frame as for `odom`; best effort', depth=50, best_effort=True)
GOAL_POSE = Topic('guidance', 'in', 'goal_pose', PoseStamped,
    'a goal with heading that replaces all others, as RViz sends it; frame as for `odom`')
GUIDANCE_ROAD = Topic('guidance', 'in', 'road', Path,
    'with `road.source: topic`: the centre line of a `corridor`, which replaces the current road; '
    'frame as for `odom`; closed if it ends where it begins; latched', depth=1, latched=True)
GUIDANCE_MAP = Topic('guidance', 'in', 'map', OccupancyGrid,
    'on `map.topic`: the map or a live costmap, in the frame `frame_id` or in one that `/tf` '
    'connects to it; latched. Where map_msgs is installed its updates as well, on the topic with '
    '`_updates` after its name', depth=1, latched=True)
COMMAND = Topic('guidance', 'out', 'cmd_vel', Twist,
    '`linear.x` [m/s], `angular.z` [rad/s], `linear.y` of a robot that drives sideways; one per '
    'control step; the last is a zero twist', depth=1)
STAMPED_COMMAND = Topic('guidance', 'out', 'cmd_vel', TwistStamped,
    'instead of Twist with `enable_stamped_cmd_vel`; with the stamp of its odometry', depth=1)
WHEELS = Topic('guidance', 'out', '~/wheel_speeds', JointState,
    'commanded wheel speeds [rad/s]; names from `robot.joint_names`', depth=OF_A_RUN)
DECISION = Topic('guidance', 'out', '~/decision', DiagnosticArray,
    'each control step, with the stamp of its odometry: fallback level, reason, terminal error, '
    'clearances, slack, iterations, active rows, times; floats read back exactly; latched',
    latched=True)
PLAN = Topic('guidance', 'out', '~/predicted_path', Path,
    'the plan, or one pose for a robot at rest; only with a subscriber', depth=OF_A_RUN)
MARKERS = Topic('guidance', 'out', '~/markers', MarkerArray,
    'road, obstacles with their margins, and goals, paler once they are passed; latched',
    depth=1, latched=True)
PLAN_MARKERS = Topic('guidance', 'out', '~/plan_markers', MarkerArray,
    'the plan coloured by fallback level and clearance, its reason, and moving obstacles with '
    'their margins; only with a subscriber', repeats=True)
FOOTPRINT = Topic('guidance', 'out', '~/footprint', PolygonStamped,
    'with `robot.footprint`: where its corners are; only with a subscriber', repeats=True)
SIGHTING = Topic('guidance', 'out', '~/sighting', OccupancyGrid,
    'with `sensors.names`: the grid of the surroundings, before the decision that uses it',
    depth=OF_A_RUN)
HEALTH = Topic('guidance', 'out', '/diagnostics', DiagnosticArray,
    'once a second and on every change: state, publishers of odometry and subscribers, fallback '
    'level, step times, missed deadlines, age of odometry and how late it comes (min, p50, p99), '
    'its messages refused, out of order and repeated, and `command_delay` as measured')
OWN_ODOM = Topic('guidance', 'out', '~/odom', Odometry,
    'odometry as used for decisions: of `robot_frame`, in the frame `frame_id`; only if it was '
    'transformed, and with a subscriber', depth=OF_A_RUN)
OWN_GOAL_POSE = Topic('guidance', 'out', '~/goal_pose', PoseStamped,
    'every goal received, in the frame `frame_id`; latched, so that a bag that begins later has '
    'it', latched=True)
OWN_MOVING = Topic('guidance', 'out', '~/moving_obstacles', PointCloud2,
    'those received in another frame, in the frame `frame_id`', depth=OF_A_RUN)
OWN_TRACKS = Topic('guidance', 'out', '~/tracks', PointCloud2,
    'moving obstacles, before the decision that uses them: all tracks of sensors and of '
    '`trackers.names` that it uses, in the frame `frame_id`, with `position_stddev` [m] and '
    '`velocity_stddev` [m/s]', depth=OF_A_RUN)
GUIDED_BY = Topic('guidance', 'out', 'cmd_vel/_guided_by', KeyValue,
    'twice a second while active: the name of the node, and since when; hidden')
GUIDED_BY_OTHERS = Topic('guidance', 'in', 'cmd_vel/_guided_by', KeyValue,
    'announcements of other nodes for the same robot; this node then does not become active')
PARAMETERS = Topic('guidance', 'out', '~/parameters', ParameterEvent,
    'all parameters, when configured and after every change, with the names of the changed ones; '
    'latched, so any bag contains what a replay needs', depth=1, latched=True)
RESET = Topic('guidance', 'srv', '~/reset', Trigger,
    'the robot stops; time 0 is the next odometry', depth=0)

SIM_COMMAND = Topic('sim', 'in', 'cmd_vel', Twist,
    'obeyed within the wheel limits')
SIM_STAMPED_COMMAND = Topic('sim', 'in', 'cmd_vel', TwistStamped,
    'instead of Twist with `enable_stamped_cmd_vel`')
SIM_ODOM = Topic('sim', 'out', 'odom', Odometry,
    'at `odom_rate` on an exact time grid, up to `odom_jitter` late, with the errors of `noise`',
    depth=OF_A_RUN)
SIM_MOVING = Topic('sim', 'out', 'moving_obstacles', PointCloud2,
    'with `moving_obstacles.names`, just before every odometry, without errors; `id` is the index '
    'of the name, from 0', depth=OF_A_RUN)
SIM_PEOPLE = Topic('sim', 'out', '~/people', PointCloud2,
    'with `sim.people.names`: the true bodies of all people just before every odometry, for '
    'judges; fields as of `moving_obstacles`, `id` in the order of the names', depth=OF_A_RUN)
SIM_SCAN = Topic('sim', 'out', 'scan', LaserScan,
    'with `sim.scan.rate`: a laser scan with the stamp of its first beam, just before the next '
    'odometry', depth=OF_A_RUN)
SIM_ROAD = Topic('sim', 'out', 'road', Path,
    'with `road.source: topic`: `road.points`, if given; latched', depth=1, latched=True)
TRUTH = Topic('sim', 'out', '~/truth', Odometry,
    'the true pose, without losses, and one more whenever the wheel speeds change', depth=OF_A_RUN)
SIM_WHEELS = Topic('sim', 'out', '~/wheel_speeds', JointState,
    'actual wheel speeds, with every `~/truth`', depth=OF_A_RUN)
CLOCK = Topic('sim', 'out', '/clock', Clock,
    'with `publish_clock`', depth=OF_A_RUN)
SIM_PARAMETERS = replace(
    PARAMETERS, node='sim', notes='all parameters, at the start and after every change; latched'
)
SIM_RESET = Topic('sim', 'srv', '~/reset', Trigger,
    'back to `initial_pose`, at rest; time continues', depth=0)

RECORDER_HEALTH = replace(
    HEALTH,
    node='recorder',
    notes='as above: messages, topics, topics left out, lost messages; for each topic the number of'
    ' messages and the time of publication of the newest [ns]',
)
RECORDER_FLUSH = Topic('recorder', 'srv', '~/flush', Trigger,
    'writes all received messages, and reports them on `/diagnostics`', depth=0)
# fmt: on

# Topics that there are where tf2_msgs is installed: no package index has it.
TRANSFORMS = (
    ('guidance', 'in', '`/tf`, `/tf_static`', 'the transforms between the frames of messages'),
    ('sim', 'out', '`/tf`', '`base_link` in the frame `frame_id`, with every odometry'),
    ('sim', 'out', '`/tf_static`', 'with `sim.scan.rate`: the scanner in `base_link`; latched'),
)

TOPICS = tuple(value for value in list(globals().values()) if isinstance(value, Topic))


def plans_of(namespace: str) -> Topic:
    """Topic of the plans of another robot."""
    return replace(OTHER_PLANS, name=PeerTrajectory.topic(namespace))
