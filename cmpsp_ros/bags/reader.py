"""Reading bags, ours and those of `ros2 bag`, with bounded memory."""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Self, cast

from rosbags.interfaces import Connection, ConnectionExtRosbag2, Qos
from rosbags.rosbag2 import Reader, ReaderError
from rosbags.typesys.store import Typestore

from cmpsp_ros.bags.custom_data import (
    PARAMETERS_KEY,
    SOFTWARE_KEY,
    VERSION_KEY,
    expected,
    parsed,
    plain_values,
)
from cmpsp_ros.bags.definitions import types_of
from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.storage.checks import check_bag
from cmpsp_ros.bags.storage.common import METADATA, SUFFIXES, is_locked

Window = tuple[float, float]  # times of reception [ns], up to but without the last
ALWAYS: Final = (-math.inf, math.inf)

_MAX_REASON = 500

PARAMETER_EVENT = 'rcl_interfaces/msg/ParameterEvent'


@dataclass(frozen=True)
class BagTopic:
    """A topic of a bag: type, number of messages, QoS of its publishers when recording began."""

    msgtype: str
    count: int
    qos_profiles: tuple[Qos, ...]


class Bag:
    """A bag opened for reading; a context manager that closes it.

    Bags are untrusted input: every fault in one becomes a `BagError`, and memory and time are
    bounded by the size of its files (see `cmpsp_ros.bags.storage.limits`). Messages are read on
    demand. A bag is a folder with a `metadata.yaml`, or a single mcap or sqlite3 file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._open = False
        self._types: dict[str, Typestore] = {}
        with self._readable('not a readable bag'):
            _check_path(path)
            information = check_bag(path)
            self._reader = Reader(path)
            self._reader.open()
        self._open = True
        try:
            with self._readable('not a readable bag'):
                self._read_summary(information)
        except BagError:
            self.close()
            raise

    def error(self, what: str) -> BagError:
        """Error that names the bag."""
        return BagError(f'{self.path}: {what}')

    def lacks(self, what: str) -> BagError:
        """Error that says what was not found, and which topics there are."""
        there = ', '.join(sorted(self.topics)) or 'no topic at all'
        return self.error(f'{what}; there is {there}')

    def require_type(self, topic: str, wanted: str) -> None:
        """Raise BagError for a topic of another type; it need not be there."""
        if topic in self.topics and (found := self.topics[topic].msgtype) != wanted:
            raise self.error(f'found {found} in {topic}, wanted {wanted}')

    def as_decided_on(self, node: str, name: str) -> str:
        """Topic that a node received; its own one of that name if it published it transformed."""
        own, heard = f'{node}/{name}', f'{node.rpartition("/")[0]}/{name}'
        return own if own in self.topics and self.topics[own].count else heard

    def raw(self, topic: str) -> Iterator[tuple[int, bytes]]:
        """Iterate over a topic's stamps [ns] and serialised messages (CDR), in order of time."""
        for _, stamp, raw in self.raw_together([topic]):
            yield stamp, raw

    def raw_together(self, topics: Sequence[str]) -> Iterator[tuple[str, int, bytes]]:
        """Iterate as `raw` over several topics in order of time, the topic's name first."""
        for connection, stamp, raw in self._records(*topics):
            yield connection.topic, stamp, raw

    def messages(self, topic: str, window: Window = ALWAYS) -> Iterator[tuple[int, Any]]:
        """Iterate as `raw`, with objects that have the fields of the message's type."""
        for _, stamp, message in self.together([topic], window):
            yield stamp, message

    def together(
        self, topics: Sequence[str], window: Window = ALWAYS
    ) -> Iterator[tuple[str, int, Any]]:
        """Iterate as `messages` over several topics in order of time, the topic's name first."""
        for connection, stamp, raw in self._records(*topics):
            if not window[0] <= stamp < window[1]:
                continue
            name, topic = connection.msgtype, connection.topic
            if name not in self._types:
                with self._readable(f'topic {topic} cannot be read'):
                    self._types[name] = types_of(connection)
            with self._readable(f'message of {topic} at {stamp} ns cannot be read'):
                message = self._types[name].deserialize_cdr(raw, name)
            yield topic, stamp, message

    def close(self) -> None:
        """Close the bag; closing twice is closing once."""
        if self._open:
            self._open = False
            self._reader.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _records(self, *topics: str) -> Iterator[tuple[Connection, int, bytes]]:
        if not self._open:
            raise self.error('the bag is closed')
        for topic in topics:
            if topic not in self.topics:
                raise self.lacks(f'no topic {topic}')
        chosen = [each for each in self._reader.connections if each.topic in topics]
        records = self._reader.messages(connections=chosen)
        count, promised = 0, sum(each.msgcount for each in chosen)
        while True:
            with self._readable(f'damaged in topic {" or ".join(topics)}'):
                record = next(records, None)
                if record is None and count < promised:
                    # rosbags silently skips messages that its index places elsewhere.
                    msg = f'found {count} messages, wanted the {promised} that it says it has'
                    raise ReaderError(msg)
            if record is None:
                return
            count += 1
            yield record

    def _read_summary(self, information: dict[str, Any]) -> None:
        self.topics: dict[str, BagTopic] = {}  # by full name
        for each in self._reader.connections:
            expected(each.topic, str, 'topic')
            expected(each.msgtype, str, f'type of {each.topic}')
            expected(each.digest, str, f'hash of the type of {each.topic}')
            expected(each.msgcount, int, f'number of messages of {each.topic}')
            before = self.topics.get(each.topic)
            ext = cast('ConnectionExtRosbag2', each.ext)
            self.topics[each.topic] = BagTopic(
                each.msgtype,
                each.msgcount + (before.count if before else 0),
                (*(before.qos_profiles if before else ()), *ext.offered_qos_profiles),
            )
        # Stamps of the first and last message [ns], 0 when there is none.
        empty = self._reader.message_count == 0
        self.start = 0 if empty else expected(self._reader.start_time, int, 'first stamp')
        # rosbags counts the end as the first nanosecond after the last message.
        self.end = 0 if empty else expected(self._reader.end_time, int, 'last stamp') - 1
        custom = expected(information.get('custom_data') or {}, dict, 'custom data')
        self.version: str = expected(custom.get(VERSION_KEY, ''), str, VERSION_KEY)
        self.software: dict[str, str] = parsed(custom, SOFTWARE_KEY)
        # By node and name, before the first change in `/parameter_events`; without those that were
        # changed before the recorder learnt their values.
        self.parameters: dict[str, dict[str, Any]] = parsed(custom, PARAMETERS_KEY)
        # By node, times of further `~/parameters` [ns] and their parameters, in order.
        self.restarts: dict[str, list[tuple[int, dict[str, Any]]]] = {}
        self._read_parameters()

    def _read_parameters(self) -> None:
        kept = self.parameters.keys()
        for topic, about in self.topics.items():
            is_one = about.msgtype == PARAMETER_EVENT and topic.endswith('/parameters')
            if not is_one or topic.removesuffix('/parameters') in kept:
                continue
            for received, message in self.messages(topic):
                if message.node not in self.parameters:
                    values = plain_values(message.new_parameters)
                    since = message.stamp.sec * 10**9 + message.stamp.nanosec
                    # Parameters changed since the recording began had other values before. Those do
                    # not matter to a node that decides later: the recorder may have missed them.
                    decided = self._first(topic.removesuffix('parameters') + 'decision')
                    is_used = since >= self.start and decided < received
                    for each in message.changed_parameters if is_used else ():
                        values.pop(each.name, None)
                    self.parameters[message.node] = values
                elif not message.changed_parameters:
                    lives = self.restarts.setdefault(message.node, [])
                    lives.append((received, plain_values(message.new_parameters)))

    def _first(self, topic: str) -> int:
        """Time of a topic's first message [ns]; 0 if there is none."""
        return next((at for at, _ in self.raw(topic)), 0) if topic in self.topics else 0

    @contextmanager
    def _readable(self, what: str) -> Iterator[None]:
        # Exceptions of parsers on hostile files cannot be listed.
        try:
            yield
        except BagError:
            raise
        except Exception as error:
            text = ' '.join(str(error).split()) or type(error).__name__
            raise self.error(f'{what}: {text[:_MAX_REASON]}') from error


def _check_path(path: Path) -> None:
    if not path.exists():
        raise BagError(f'{path}: no such bag')
    if path.is_file() and path.suffix not in SUFFIXES:
        raise BagError(
            f'{path}: not a bag: expected a folder, or a file that ends in {" or ".join(SUFFIXES)}'
        )
    if path.is_dir() and not (path / METADATA).exists():
        wanted = f'expected a {METADATA} in this folder'
        said = (
            f'the recording was cut off: {wanted}; `cmpsp recover {path}` makes a whole bag of it'
        )
        if not any(next(path.glob(f'*{each}'), None) for each in SUFFIXES):
            said = f'not a bag: {wanted}'
        elif is_locked(path):
            said = f'being written right now: {wanted} once it is closed'
        raise BagError(f'{path}: {said}')
