"""Bags as tables for pandas and spreadsheets: CSV or Parquet, one file per kind of topic."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, Literal

from cmpsp_ros.bags.decision_record import DecisionRecord, entries_of, status_of
from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.guidance import DECISION_KEYS, truth
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


Rows = Callable[[Any, tuple[Column, ...]], Iterator[Row]]
"""Rows of a message, for the columns of its table; without time of reception and topic."""

Columns = tuple[Column, ...] | Callable[[Bag, list[str]], tuple[Column, ...]]
"""Columns of a table, or how to find them in the topics of a bag."""


def _floats(names: str) -> tuple[Column, ...]:
    return tuple(Column(name, 'float', unit) for name, unit in map(str.split, names.split(',')))


_WHERE = (Column('received', 'int', 'ns'), Column('topic', 'text'), Column('stamp', 'int', 'ns'))
_FRAME, _POINT, _AT = Column('frame', 'text'), Column('point', 'int'), Column('at', 'int', 'ns')
_POSE = _floats('x m, y m, heading rad')
_TWIST = _floats('speed m/s, turn_rate rad/s, side_speed m/s')
_MOVING = (*(*_WHERE, _FRAME, Column('id', 'int')), *_floats('x m, y m, vx m/s, vy m/s, radius m'))

_BEFORE_ENTRIES = (*_WHERE[:2], Column('reason', 'text'))

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
            return {
                path: write(table, path)
                for table in chosen
                for path in [folder / f'{table.name}.{form}']
            }
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
    for name, types, ending, columns, rows in _TABLES:
        topics = [
            topic
            for topic, about in sorted(bag.topics.items())
            if about.msgtype in types.split() and topic.endswith(ending)
        ]
        if topics:
            wide = columns(bag, topics) if callable(columns) else columns
            found.append(Table(name, wide, _read(bag, topics, wide, rows)))
    if not found:
        raise bag.lacks('no topic that makes a table')
    return found


def _read(bag: Bag, topics: list[str], columns: tuple[Column, ...], rows: Rows) -> Iterator[Row]:
    for topic, received, message in bag.together(topics):
        try:
            for row in rows(message, columns):
                yield received, topic, *row
        except (ValueError, LookupError) as error:
            raise BagError(f'{bag.path}: message of {topic} at {received} ns: {error}') from error


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
    """Columns of decisions: the union over all, for their keys differ."""
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
    if key not in DECISION_KEYS:
        return Column(key, 'text')
    parse, unit = DECISION_KEYS[key]
    return Column(key, _KINDS.get(parse, 'text'), unit)


def _key(column: Column) -> str:
    return f'{column.name.removesuffix("_time")}_ms' if column.unit == 'ms' else column.name


def _pose(pose: Any) -> tuple[float, float, float]:
    return pose.position.x, pose.position.y, heading_of(pose.orientation)


def _write_csv(table: Table, path: Path) -> int:
    with path.open('x', newline='', encoding='utf-8') as file:
        writer = csv.writer(file)
        titles = (f'{each.name} [{each.unit}]'.removesuffix(' []') for each in table.columns)
        writer.writerow(titles)
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
                columns = [
                    pa.array(cells, each.type)
                    for cells, each in zip(zip(*batch, strict=True), schema, strict=True)
                ]
                writer.write_table(pa.Table.from_arrays(columns, schema=schema))
                count += len(batch)
        return count

    return write


_TABLES: tuple[tuple[str, str, str, Columns, Rows], ...] = (
    ('odometry', 'nav_msgs/msg/Odometry', '', (*_WHERE, _FRAME, *_POSE, *_TWIST), _odometry),
    (
        'commands',
        'geometry_msgs/msg/Twist geometry_msgs/msg/TwistStamped',
        '',
        (*_WHERE, *_TWIST),
        _commands,
    ),
    ('wheel_speeds', 'sensor_msgs/msg/JointState', '/wheel_speeds', _wheel_columns, _wheels),
    (
        'decisions',
        # As they are published, and as they were before.
        'diagnostic_msgs/msg/DiagnosticArray diagnostic_msgs/msg/DiagnosticStatus',
        '/decision',
        _decision_columns,
        _decisions,
    ),
    ('plan', 'nav_msgs/msg/Path', '/predicted_path', (*_WHERE, _POINT, _AT, *_POSE), _plan),
    ('goals', 'geometry_msgs/msg/PoseStamped', '/goal_pose', (*_WHERE, _FRAME, *_POSE), _goals),
    ('moving', 'sensor_msgs/msg/PointCloud2', '/moving_obstacles', _MOVING, _moving),
    ('road', 'nav_msgs/msg/Path', '/road', (*_WHERE, _FRAME, _POINT, *_POSE[:2]), _road),
)
"""Name of each table, types of its topics, how their names end, its columns and its rows."""
