"""Writing bags that stay readable however the writing ends."""

from __future__ import annotations

import json
from array import array
from collections.abc import Sequence
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING

from rosbags.rosbag2 import StoragePlugin, WriterError
from rosbags.typesys import Stores, get_typestore

from cmpsp_ros.bags.errors import BagError, UnknownTypeError
from cmpsp_ros.bags.mcap_storage import RevocableWriter

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path
    from types import TracebackType
    from typing import Self

    from rosbags.interfaces import Connection, Qos

PARAMETERS_KEY = 'cmpsp_ros.parameters'
"""Key in the bag's custom data: JSON text `{node: {parameter: value}}`."""

VERSION_KEY = 'cmpsp_ros.version'
"""Key in the bag's custom data: version of this package that wrote the bag."""


class BagWriter:
    """A new bag: mcap storage, metadata version 9, ROS 2 Jazzy message definitions.

    As a context manager it closes the bag on every way out of the block, `KeyboardInterrupt`
    included. Not thread-safe.

    Args:
        path: Folder of the bag; must not exist, missing parents are made.

    Raises:
        BagError: The path exists or cannot be created.

    """

    def __init__(self, path: Path) -> None:
        if path.exists():
            msg = f'{path}: exists already, a new bag needs a path that does not exist'
            raise BagError(msg)
        self.path = path
        self._typestore = get_typestore(Stores.ROS2_JAZZY)
        self._topics: dict[str, Connection] = {}
        self._parameters: dict[str, dict[str, object]] = {}
        self._closed = False
        self._writer = RevocableWriter(path, version=9, storage_plugin=StoragePlugin.MCAP)
        try:
            self._writer.open()
        except (OSError, WriterError) as error:
            msg = f'{path}: cannot create the bag: {error}'
            raise BagError(msg) from error

    @property
    def message_count(self) -> int:
        """Number of messages written."""
        return sum(self._writer.counts.values())

    def topic(self, name: str, msgtype: str, qos_profiles: Sequence[Qos] = ()) -> None:
        """Add a topic.

        Args:
            name: Full name, as in `/odom`.
            msgtype: Type, as in `nav_msgs/msg/Odometry`.
            qos_profiles: What the publishers offer, one profile each.

        Raises:
            UnknownTypeError: No definition of the type is known; the bag goes on without it.
            BagError: The topic has been added already, or the bag is closed.

        """
        self._check_open()
        if name in self._topics:
            msg = f'{self.path}: topic {name} has been added already'
            raise BagError(msg)
        if msgtype not in self._typestore.fielddefs:
            msg = f'{self.path}: topic {name} left out: no definition of its type {msgtype}'
            raise UnknownTypeError(msg)
        self._topics[name] = self._writer.add_connection(
            name, msgtype, typestore=self._typestore, offered_qos_profiles=qos_profiles
        )

    def write(self, topic: str, stamp_ns: int, raw: bytes) -> None:
        """Write one message.

        Args:
            topic: Name of a topic added before.
            stamp_ns: Time of reception [ns].
            raw: The serialised message (CDR).

        Raises:
            BagError: Unknown topic, bag closed, or the disk refuses.

        """
        self._check_open()
        if topic not in self._topics:
            msg = f'{self.path}: write to topic {topic}, which has not been added'
            raise BagError(msg)
        try:
            self._writer.write(self._topics[topic], stamp_ns, raw)
        except OSError as error:
            msg = f'{self.path}: cannot write to the bag: {error}'
            raise BagError(msg) from error

    def flush(self) -> None:
        """Hand everything written so far to the operating system.

        What has been flushed can be recovered from a bag whose process was killed.

        Raises:
            BagError: The bag is closed, or the disk refuses.

        """
        self._check_open()
        try:
            self._writer.flush()
        except OSError as error:
            msg = f'{self.path}: cannot write to the bag: {error}'
            raise BagError(msg) from error

    def set_parameters(self, node_name: str, values: Mapping[str, object]) -> None:
        """Keep a node's parameters with the bag, in place of any kept for it before.

        Args:
            node_name: Full name, as in `/guidance`.
            values: Booleans, integers, floats, strings and sequences of these by parameter name;
                byte arrays are kept as lists of integers. Floats read back bit for bit.

        Raises:
            BagError: The bag is closed, or a value is of another kind.

        """
        self._check_open()
        self._parameters[node_name] = {
            name: _plain(value, f'{self.path}: parameter {name} of {node_name}')
            for name, value in values.items()
        }

    def close(self) -> None:
        """Write index and metadata; closing twice is closing once.

        After the disk has refused a write, the end of the recording is given up, so that the
        rest makes a complete bag in the space there is.

        Raises:
            BagError: The disk refuses: the bag is cut off, or its last messages are missing.

        """
        if self._closed:
            return
        self._closed = True
        self._writer.set_custom_data(VERSION_KEY, _software_version())
        self._writer.set_custom_data(PARAMETERS_KEY, json.dumps(self._parameters))
        try:
            self._writer.flush()
            self._writer.close()
        except OSError as error:
            try:
                lost = self._writer.make_room()
                self._writer.close()
            except OSError:
                with suppress(OSError):
                    self._writer.abort()
                msg = f'{self.path}: cut off, without index and metadata: {error}'
                raise BagError(msg) from error
            msg = f'{self.path}: closed without its last {lost} messages: {error}'
            raise BagError(msg) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            self.close()
        except BagError:
            # What went wrong inside the block is the cause and must not be hidden.
            if error is None:
                raise

    def _check_open(self) -> None:
        if self._closed:
            msg = f'{self.path}: the bag is closed'
            raise BagError(msg)


def _plain(value: object, what: str) -> object:
    """Reduce a parameter's value to what JSON has."""
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    if isinstance(value, (Sequence, array)):
        return [_plain(each, what) for each in value]
    msg = f'{what} is a {type(value).__name__}, which a bag cannot keep'
    raise BagError(msg)


def _software_version() -> str:
    try:
        return version('cmpsp_ros')
    except PackageNotFoundError:
        return 'unknown'
