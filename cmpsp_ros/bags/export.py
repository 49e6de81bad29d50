"""Bags as tables for pandas and spreadsheets: CSV or Parquet, one file per kind of topic."""

import csv
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, Literal

from cmpsp_ros.bags.decision_record import DecisionRecord
from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.guidance import DECISION_KEYS, Key, truth
from cmpsp_ros.guidance.messages import TrackError, heading_of, tracks_of
from cmpsp_ros.sensing import stamp_of

Format = Literal['csv', 'parquet']
Kind = Literal['int', 'float', 'bool', 'text']
Cell = int | float | bool | str | None
Row = tuple[Cell, ...]

_BATCH = 10_000  # rows held at a time


@dataclass(frozen=True)
class Column:
    """One column: its name, type of its values, any of which may be missing, and its unit."""

    name: str
    kind: Kind
    unit: str = ''


@dataclass(frozen=True)
class Table:
    """One table, whose rows are read on demand, in order of reception."""

    name: str
    columns: tuple[Column, ...]
    rows: Iterator[Row]


# Columns of a table, and rows of a message without time of reception and topic.
Layout = tuple[tuple[Column, ...], Callable[[Any], Iterator[Row]]]


def _floats(names: str) -> tuple[Column, ...]:
    return tuple(Column(name, 'float', unit) for name, unit in map(str.split, names.split(',')))


_WHERE = (Column('received', 'int', 'ns'), Column('topic', 'text'), Column('stamp', 'int', 'ns'))
_FRAME, _POINT, _AT = Column('frame', 'text'), Column('point', 'int'), Column('at', 'int', 'ns')
_POSE = _floats('x m, y m, heading rad')
_TWIST = _floats('speed m/s, turn_rate rad/s, side_speed m/s')
_MOVING = (*(*_WHERE, _FRAME, Column('id', 'int')), *_floats('x m, y m, vx m/s, vy m/s, radius m'))

_TWO_WHEELS = 'right', 'left'
_MAX_KEYS = 200

_KINDS: dict[object, Kind] = {int: 'int', float: 'float', truth: 'bool', str: 'text'}


def export(bag_path: Path, folder: Path, form: Format = 'csv') -> dict[Path, int]:
    """Write the tables of a bag; returns the number of rows of each file.

    CSV names columns with their units, as in `x [m]`, and floats read back bit for bit; Parquet
    keeps the unit in the field's metadata. Raises BagError if nothing makes a table, the folder
    exists, or pyarrow is missing.
    """
    write = _write_csv if form == 'csv' else _parquet_writer()
    with Bag(bag_path) as bag:
        chosen = tables(bag)
        try:
            folder.mkdir(parents=True)
            paths = [folder / f'{table.name}.{form}' for table in chosen]
            return {path: write(table, path) for path, table in zip(paths, chosen, strict=True)}
        except FileExistsError as error:
            msg = f'{folder}: exists already, tables need a folder that does not exist'
            raise BagError(msg) from error
        except OSError as error:
            raise BagError(f'{folder}: cannot write the tables: {error}') from error


def tables(bag: Bag) -> list[Table]:
    """The tables of a bag: those for which it has topics.

    Wheel speeds, decisions and plans are found by their names, too: not all joints and paths
    are ours.
    """
    found = []
    for name, types, ending, layout in _TABLES:
        topics = [
            topic
            for topic, about in sorted(bag.topics.items())
            if about.msgtype in types.split() and topic.endswith(ending)
        ]
        if topics:
            columns, rows = layout(bag, topics) if callable(layout) else layout
            found.append(Table(name, columns, _read(bag, topics, rows)))
    if not found:
        raise bag.lacks('no topic that makes a table')
    return found


def _read(bag: Bag, topics: list[str], rows: Callable[[Any], Iterator[Row]]) -> Iterator[Row]:
    for topic, received, message in bag.together(topics):
        try:
            for row in rows(message):
                yield received, topic, *row
        except (ValueError, LookupError) as error:
            raise bag.error(f'message of {topic} at {received} ns: {error}') from error


def _odometry(message: Any) -> Iterator[Row]:
    twist = message.twist.twist
    yield (stamp_of(message), message.header.frame_id, *_pose(message.pose.pose), *_twist(twist))


def _commands(message: Any) -> Iterator[Row]:
    stamped = hasattr(message, 'header')
    twist = message.twist if stamped else message
    yield stamp_of(message) if stamped else None, *_twist(twist)


def _twist(twist: Any) -> tuple[float, float, float]:
    return twist.linear.x, twist.angular.z, twist.linear.y


def _wheels(bag: Bag, topics: list[str]) -> Layout:
    """Right and left, or the joints of a robot with another number of wheels."""
    _, _, first = next(bag.together(topics), (None, None, None))
    names = [] if first is None else list(first.name)
    names = names if len(names) not in {0, len(_TWO_WHEELS)} else list(_TWO_WHEELS)

    def rows(message: Any) -> Iterator[Row]:
        if len(message.velocity) != len(names):
            found = f'{len(message.velocity)} wheel speeds'
            raise ValueError(f'found {found}, wanted {" and ".join(names)}')
        yield stamp_of(message), *map(float, message.velocity)

    return (*_WHERE, *(Column(each, 'float', 'rad/s') for each in names)), rows


def _plan(message: Any) -> Iterator[Row]:
    for point, each in enumerate(message.poses):
        yield stamp_of(message), point, stamp_of(each), *_pose(each.pose)


def _goals(message: Any) -> Iterator[Row]:
    yield stamp_of(message), message.header.frame_id, *_pose(message.pose)


def _moving(message: Any) -> Iterator[Row]:
    frame = message.header.frame_id
    try:
        tracks = tracks_of(message, frame)
    except TrackError:
        # The nodes made nothing of it either.
        return
    for each in tracks:
        yield each.stamp, frame, each.id, each.x, each.y, each.vx, each.vy, each.radius


def _road(message: Any) -> Iterator[Row]:
    for point, each in enumerate(message.poses):
        place = each.pose.position
        yield stamp_of(message), message.header.frame_id, point, place.x, place.y


def _decisions(bag: Bag, topics: list[str]) -> Layout:
    """Reason and entries: the union over all decisions, for their keys differ."""
    entries: dict[str, tuple[Column, Callable[[str], Cell]]] = {}
    for topic, received, message in bag.together(topics):
        for key in DecisionRecord.of(topic, received, message).entries:
            entries.setdefault(key, _entry(key))
        if len(entries) > _MAX_KEYS:
            raise bag.error(f'over {_MAX_KEYS} keys in {" and ".join(topics)}, wanted decisions')

    def rows(message: Any) -> Iterator[Row]:
        found = DecisionRecord.of('', 0, message)
        texts = found.entries
        cells = (parse(texts[key]) if key in texts else None for key, (_, parse) in entries.items())
        yield found.reason, *cells

    columns = (column for column, _ in entries.values())
    return (*_WHERE[:2], Column('reason', 'text'), *columns), rows


def _entry(key: str) -> tuple[Column, Callable[[str], Cell]]:
    """Column of an entry of decisions, and how to read it."""
    if key.endswith('_ms'):
        return Column(f'{key.removesuffix("_ms")}_time', 'float', 'ms'), float
    parse, unit = DECISION_KEYS.get(key, Key(str))
    kind = _KINDS.get(parse, 'text')
    return Column(key, kind, unit), parse if kind != 'text' else str


def _pose(pose: Any) -> tuple[float, float, float]:
    return pose.position.x, pose.position.y, heading_of(pose.orientation)


def _write_csv(table: Table, path: Path) -> int:
    with path.open('x', newline='', encoding='utf-8') as file:
        writer = csv.writer(file)
        writer.writerow(f'{each.name} [{each.unit}]'.removesuffix(' []') for each in table.columns)
        count = 0
        for count, row in enumerate(table.rows, 1):  # noqa: B007 (the last counts)
            writer.writerow(row)
    return count


def _parquet_writer() -> Callable[[Table, Path], int]:
    try:
        import pyarrow as pa  # type: ignore[import-untyped]  # noqa: PLC0415 (not all need it)
        from pyarrow import parquet  # noqa: PLC0415
    except ImportError as error:
        raise BagError('Parquet needs pyarrow: pip install pyarrow') from error

    types = {'int': pa.int64(), 'float': pa.float64(), 'bool': pa.bool_(), 'text': pa.string()}

    def write(table: Table, path: Path) -> int:
        schema = pa.schema(
            pa.field(each.name, types[each.kind], metadata={'unit': each.unit} if each.unit else {})
            for each in table.columns
        )
        count = 0
        with parquet.ParquetWriter(path, schema) as writer:
            while batch := list(islice(table.rows, _BATCH)):
                columns = dict(zip(schema.names, zip(*batch, strict=True), strict=True))
                writer.write_table(pa.Table.from_pydict(columns, schema=schema))
                count += len(batch)
        return count

    return write


_Makes = Callable[[Bag, list[str]], Layout]
# Decisions as they are published, and as they were before.
_DECISIONS = 'diagnostic_msgs/msg/DiagnosticArray diagnostic_msgs/msg/DiagnosticStatus'
_TWISTS = 'geometry_msgs/msg/Twist geometry_msgs/msg/TwistStamped'
# Name of each table, types of its topics, how their names end, and its layout.
_TABLES: tuple[tuple[str, str, str, Layout | _Makes], ...] = (
    ('odometry', 'nav_msgs/msg/Odometry', '', ((*_WHERE, _FRAME, *_POSE, *_TWIST), _odometry)),
    ('commands', _TWISTS, '', ((*_WHERE, *_TWIST), _commands)),
    ('wheel_speeds', 'sensor_msgs/msg/JointState', '/wheel_speeds', _wheels),
    ('decisions', _DECISIONS, '/decision', _decisions),
    ('plan', 'nav_msgs/msg/Path', '/predicted_path', ((*_WHERE, _POINT, _AT, *_POSE), _plan)),
    ('goals', 'geometry_msgs/msg/PoseStamped', '/goal_pose', ((*_WHERE, _FRAME, *_POSE), _goals)),
    ('moving', 'sensor_msgs/msg/PointCloud2', '/moving_obstacles', (_MOVING, _moving)),
    ('road', 'nav_msgs/msg/Path', '/road', ((*_WHERE, _FRAME, _POINT, *_POSE[:2]), _road)),
)
