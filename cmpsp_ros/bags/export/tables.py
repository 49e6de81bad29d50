"""The contents of a bag as tables: one per kind of topic, with named columns and units."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Literal

from cmpsp_ros.bags.decision_record import ENTRIES, DecisionRecord, entries_of, status_of, truth
from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.guidance.messages import TrackError, heading_of, tracks_of
from cmpsp_ros.sensing import stamp_of

Kind = Literal['int', 'float', 'bool', 'text']
Cell = int | float | bool | str | None
Row = tuple[Cell, ...]


@dataclass(frozen=True)
class Column:
    """One column.

    Attributes:
        name: Its name.
        kind: Type of its values; any value may be missing.
        unit: Unit, empty where there is none.
    """

    name: str
    kind: Kind
    unit: str = ''


@dataclass(frozen=True)
class Table:
    """One table, whose rows are read on demand.

    Attributes:
        name: Its name.
        columns: Its columns.
        rows: Iterates over the rows, in order of reception.
    """

    name: str
    columns: tuple[Column, ...]
    rows: Callable[[], Iterator[Row]]


_WHERE = (Column('received', 'int', 'ns'), Column('topic', 'text'), Column('stamp', 'int', 'ns'))
_POSE = (Column('x', 'float', 'm'), Column('y', 'float', 'm'), Column('heading', 'float', 'rad'))
_TWIST = (
    Column('speed', 'float', 'm/s'),
    Column('turn_rate', 'float', 'rad/s'),
    Column('side_speed', 'float', 'm/s'),
)

_ODOMETRY = (*_WHERE, Column('frame', 'text'), *_POSE, *_TWIST)
_COMMANDS = (*_WHERE, *_TWIST)
_GOALS = (*_WHERE, Column('frame', 'text'), *_POSE)
_MOVING = (
    *_WHERE,
    Column('frame', 'text'),
    Column('id', 'int'),
    Column('x', 'float', 'm'),
    Column('y', 'float', 'm'),
    Column('vx', 'float', 'm/s'),
    Column('vy', 'float', 'm/s'),
    Column('radius', 'float', 'm'),
)
_ROAD = (
    *_WHERE,
    Column('frame', 'text'),
    Column('point', 'int'),
    Column('x', 'float', 'm'),
    Column('y', 'float', 'm'),
)
_PLAN = (*_WHERE, Column('point', 'int'), Column('at', 'int', 'ns'), *_POSE)

_BEFORE_ENTRIES = (
    Column('received', 'int', 'ns'),
    Column('topic', 'text'),
    Column('reason', 'text'),
)

_TWO_WHEELS = 'right', 'left'

_OF_DECISIONS = ('diagnostic_msgs/msg/DiagnosticArray', 'diagnostic_msgs/msg/DiagnosticStatus')
"""As they are published, and as they were before."""

_MAX_KEYS = 200

_KINDS: dict[object, Kind] = {int: 'int', float: 'float', truth: 'bool', str: 'text'}


def tables(bag: Bag) -> list[Table]:
    """The tables of a bag: those for which it has topics.

    Odometry and commands are found by their types; wheel speeds, decisions and plans by their
    names, too, so that joints and paths of other nodes are not taken for ours.

    Raises:
        BagError: There is none, or the bag is damaged.
    """
    found = []
    for name, types, ending, columns, rows in (
        ('odometry', ('nav_msgs/msg/Odometry',), '', _ODOMETRY, _odometry),
        (
            'commands',
            ('geometry_msgs/msg/Twist', 'geometry_msgs/msg/TwistStamped'),
            '',
            _COMMANDS,
            _commands,
        ),
        ('wheel_speeds', ('sensor_msgs/msg/JointState',), '/wheel_speeds', _wheel_columns, _wheels),
        ('decisions', _OF_DECISIONS, '/decision', _decision_columns, _decisions),
        ('plan', ('nav_msgs/msg/Path',), '/predicted_path', _PLAN, _plan),
        ('goals', ('geometry_msgs/msg/PoseStamped',), '/goal_pose', _GOALS, _goals),
        ('moving', ('sensor_msgs/msg/PointCloud2',), '/moving_obstacles', _MOVING, _moving),
        ('road', ('nav_msgs/msg/Path',), '/road', _ROAD, _road),
    ):
        topics = [
            topic
            for topic, about in sorted(bag.topics.items())
            if about.msgtype in types and topic.endswith(ending)
        ]
        if topics:
            wide = columns(bag, topics) if callable(columns) else columns
            found.append(Table(name, wide, _reading(bag, topics, wide, rows)))
    if not found:
        there = ', '.join(sorted(bag.topics)) or 'no topic at all'
        raise BagError(f'{bag.path}: no topic that makes a table; there is {there}')
    return found


def _reading(
    bag: Bag,
    topics: list[str],
    columns: tuple[Column, ...],
    rows: Callable[[Any, tuple[Column, ...]], Iterator[Row]],
) -> Callable[[], Iterator[Row]]:
    def read() -> Iterator[Row]:
        for topic, received, message in bag.together(topics):
            try:
                for row in rows(message, columns):
                    yield received, topic, *row
            except (ValueError, LookupError) as error:
                msg = f'{bag.path}: message of {topic} at {received} ns: {error}'
                raise BagError(msg) from error

    return read


def _odometry(message: Any, _columns: tuple[Column, ...]) -> Iterator[Row]:
    twist = message.twist.twist
    yield (stamp_of(message), message.header.frame_id, *_pose(message.pose.pose), *_twist(twist))


def _commands(message: Any, _columns: tuple[Column, ...]) -> Iterator[Row]:
    stamped = hasattr(message, 'header')
    twist = message.twist if stamped else message
    yield stamp_of(message) if stamped else None, *_twist(twist)


def _twist(twist: Any) -> tuple[float, float, float]:
    return twist.linear.x, twist.angular.z, twist.linear.y


def _wheels(message: Any, columns: tuple[Column, ...]) -> Iterator[Row]:
    names = [each.name for each in columns[len(_WHERE) :]]
    if len(message.velocity) != len(names):
        found = f'{len(message.velocity)} wheel speeds'
        raise ValueError(f'found {found}, wanted {" and ".join(names)}')
    yield stamp_of(message), *map(float, message.velocity)


def _wheel_columns(bag: Bag, topics: list[str]) -> tuple[Column, ...]:
    """Right and left, or the joints of a robot with another number of wheels."""
    _, _, message = next(bag.together(topics), (None, None, None))
    names = [] if message is None else list(message.name)
    names = names if len(names) not in {0, len(_TWO_WHEELS)} else list(_TWO_WHEELS)
    return (*_WHERE, *(Column(each, 'float', 'rad/s') for each in names))


def _plan(message: Any, _columns: tuple[Column, ...]) -> Iterator[Row]:
    for point, each in enumerate(message.poses):
        yield stamp_of(message), point, stamp_of(each), *_pose(each.pose)


def _goals(message: Any, _columns: tuple[Column, ...]) -> Iterator[Row]:
    yield stamp_of(message), message.header.frame_id, *_pose(message.pose)


def _moving(message: Any, _columns: tuple[Column, ...]) -> Iterator[Row]:
    frame = message.header.frame_id
    try:
        tracks = tracks_of(message, frame)
    except TrackError:
        # The nodes made nothing of it either.
        return
    for each in tracks:
        yield each.stamp, frame, each.id, each.x, each.y, each.vx, each.vy, each.radius


def _road(message: Any, _columns: tuple[Column, ...]) -> Iterator[Row]:
    for point, each in enumerate(message.poses):
        place = each.pose.position
        yield stamp_of(message), message.header.frame_id, point, place.x, place.y


def _decisions(message: Any, columns: tuple[Column, ...]) -> Iterator[Row]:
    status = status_of(message)
    values = entries_of(status)
    entries = columns[len(_BEFORE_ENTRIES) :]
    yield status.message, *(_cell(each, values.get(_key(each))) for each in entries)


def _cell(column: Column, text: str | None) -> Cell:
    if text is None:
        return None
    parse: dict[Kind, Callable[[str], Cell]] = {'int': int, 'float': float, 'bool': truth}
    return parse.get(column.kind, str)(text)


def _decision_columns(bag: Bag, topics: list[str]) -> tuple[Column, ...]:
    """Columns of decisions: not all of them say the same, so that all have to be asked."""
    keys: dict[str, None] = {}
    for topic, received, message in bag.together(topics):
        keys.update(dict.fromkeys(DecisionRecord.of(topic, received, message).entries))
        if len(keys) > _MAX_KEYS:
            msg = f'{bag.path}: over {_MAX_KEYS} keys in {" and ".join(topics)}, wanted decisions'
            raise BagError(msg)
    return (*_BEFORE_ENTRIES, *map(_entry_column, keys))


def _entry_column(key: str) -> Column:
    if key.endswith('_ms'):
        return Column(f'{key.removesuffix("_ms")}_time', 'float', 'ms')
    if key not in ENTRIES:
        return Column(key, 'text')
    return Column(key, _KINDS.get(ENTRIES[key].parse, 'text'), ENTRIES[key].unit)


def _key(column: Column) -> str:
    return f'{column.name.removesuffix("_time")}_ms' if column.unit == 'ms' else column.name


def _pose(pose: Any) -> tuple[float, float, float]:
    return pose.position.x, pose.position.y, heading_of(pose.orientation)
