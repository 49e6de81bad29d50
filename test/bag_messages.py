"""Messages for bags that tests make, by the types of rosbags: no ROS is needed."""

import math
import struct

import numpy as np
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)

from cmpsp_ros.bags import BagWriter
from cmpsp_ros.bags.definitions import jazzy
from cmpsp_ros.guidance.messages import Track

SECOND = 1_000_000_000
ODOMETRY, JOINTS = 'nav_msgs/msg/Odometry', 'sensor_msgs/msg/JointState'
TWIST, STAMPED = 'geometry_msgs/msg/Twist', 'geometry_msgs/msg/TwistStamped'
STATUS, ARRAY = 'diagnostic_msgs/msg/DiagnosticStatus', 'diagnostic_msgs/msg/DiagnosticArray'
PATH, POSE = 'nav_msgs/msg/Path', 'geometry_msgs/msg/PoseStamped'
CLOUD, EVENT = 'sensor_msgs/msg/PointCloud2', 'rcl_interfaces/msg/ParameterEvent'
STRING = 'std_msgs/msg/String'
GRID = 'nav_msgs/msg/OccupancyGrid'
HELLO = b'\x00\x01\x00\x00\x06\x00\x00\x00hello\x00'

FOREVER = QosTime(9223372036, 854775807)
LATCHED = Qos(
    QosHistory.UNKNOWN,
    0,
    QosReliability.RELIABLE,
    QosDurability.TRANSIENT_LOCAL,
    FOREVER,
    FOREVER,
    QosLiveliness.AUTOMATIC,
    FOREVER,
    False,
)


def make(name, *fields):
    return jazzy().types[name](*fields)


def raw(message):
    return bytes(jazzy().serialize_cdr(message, message.__msgtype__))


def write_bag(path, records, parameters=None, kinds=None):
    """Write a bag.

    Args:
        path: New bag.
        records: Topic, time of reception [ns] and message of each; or its bytes.
        parameters: By node.
        kinds: Types of topics whose messages are bytes, or that have none.
    """
    with BagWriter(path) as bag:
        known = dict(kinds or {})
        for topic, kind in known.items():
            bag.topic(topic, kind)
        for topic, received, message in records:
            if topic not in known:
                known[topic] = message.__msgtype__
                bag.topic(topic, known[topic])
            bag.write(topic, received, message if isinstance(message, bytes) else raw(message))
        for node, values in (parameters or {}).items():
            bag.set_parameters(node, values)
    return path


def time(stamp):
    return make('builtin_interfaces/msg/Time', *divmod(stamp, SECOND))


def header(stamp, frame_id='odom'):
    return make('std_msgs/msg/Header', time(stamp), frame_id)


def pose(x, y, heading=0.0):
    turn = math.sin(heading / 2.0), math.cos(heading / 2.0)
    return make(
        'geometry_msgs/msg/Pose',
        make('geometry_msgs/msg/Point', float(x), float(y), 0.0),
        make('geometry_msgs/msg/Quaternion', 0.0, 0.0, *turn),
    )


def pose_stamped(stamp, place, frame_id='odom'):
    return make(POSE, header(stamp, frame_id), pose(*place))


def twist(speed, *rest):
    """Twist of (speed, turn rate), or of (forward, to the left, turn rate)."""
    left, turn_rate = (0.0, *rest)[-2:]
    vector = jazzy().types['geometry_msgs/msg/Vector3']
    return make(TWIST, vector(float(speed), float(left), 0.0), vector(0.0, 0.0, float(turn_rate)))


def odometry(stamp, place, motion=(0.0, 0.0), frame_id='odom', spread=0.0):
    """Odometry of a pose (x, y, heading), a speed and a turn rate."""
    covariance = np.zeros(36)
    covariance[[0, 7, 35]] = spread**2
    placed = make('geometry_msgs/msg/PoseWithCovariance', pose(*map(float, place)), covariance)
    moving = make('geometry_msgs/msg/TwistWithCovariance', twist(*motion), covariance)
    return make(ODOMETRY, header(stamp, frame_id), 'base_link', placed, moving)


def joints(stamp, speeds):
    none = np.zeros(0)
    return make(JOINTS, header(stamp), ['right', 'left'], none, np.array(speeds, float), none)


PLAIN_DECISION = {
    'step': 0,
    'fallback_level': 'nominal',
    'wheel_speed_right': 45.0,
    'wheel_speed_left': 44.0,
    **dict.fromkeys(('finished', 'missed', 'halted'), 'false'),
    **dict.fromkeys(('run', 'revision'), 0),
}


def status(reason='Well.', /, **values):
    pair = jazzy().types['diagnostic_msgs/msg/KeyValue']
    pairs = [pair(key, str(value)) for key, value in values.items()]
    return make(STATUS, 0, 'decision', reason, '', pairs)


def path(stamp, places, frame_id='odom', stamps=None):
    """A path through places (x, y) or (x, y, heading), each with a stamp of its own."""
    stamps = [stamp] * len(places) if stamps is None else stamps
    each = zip(stamps, places, strict=True)
    return make(PATH, header(stamp, frame_id), [pose_stamped(*one, frame_id) for one in each])


def cloud(stamp, points, frame_id='odom'):
    """Moving obstacles: (id, x, y, vx, vy, radius) each, and (position_stddev, velocity_stddev)."""
    field = jazzy().types['sensor_msgs/msg/PointField']
    size = max((len(values) for _, *values in points), default=len(Track.FIELDS))
    names = (*Track.FIELDS, *Track.DOUBTS)[:size]
    fields = [field(name, 8 * place, 8, 1) for place, name in enumerate(names)]
    data = b''.join(struct.pack(f'<{size}di', *values, number) for number, *values in points)
    count, step = len(points), 8 * size + 4
    return make(
        CLOUD, header(stamp, frame_id), 1, count, [*fields, field('id', step - 4, 5, 1)], False,
        step, step * count, np.frombuffer(data, np.uint8), True,
    )  # fmt: skip


def grid(stamp, cells, origin=(0.0, 0.0), resolution=0.05, frame_id='odom'):
    """A grid along the axes: values as in a nav_msgs/OccupancyGrid, in rows."""
    values = np.asarray(cells, np.int8)
    high, wide = values.shape
    info = make('nav_msgs/msg/MapMetaData', time(stamp), resolution, wide, high, pose(*origin))
    return make(GRID, header(stamp, frame_id), info, values.reshape(-1))


def parameter_event(node, changes, stamp=0):
    """Live changes of a node's parameters by key."""
    return make(EVENT, time(stamp), node, [], [_parameter(*each) for each in changes.items()], [])


def all_parameters(node, values, stamp=0):
    """The parameters that a node began with, as it publishes them on `~/parameters`."""
    return make(EVENT, time(stamp), node, [_parameter(*each) for each in values.items()], [], [])


def _parameter(name, value):
    empty = np.zeros(0, np.uint8), np.zeros(0, bool), np.zeros(0, np.int64), np.zeros(0), []
    fields = [False, 0, 0.0, '', *empty]
    many = isinstance(value, list)
    first = (value or [''])[0] if many else value
    kind = 5 * many + [bool, int, float, str].index(type(first))
    fields[kind] = np.array(value) if many and not isinstance(first, str) else value
    held = make('rcl_interfaces/msg/ParameterValue', kind + 1, *fields)
    return make('rcl_interfaces/msg/Parameter', name, held)
