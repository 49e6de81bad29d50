"""Writing bags that stay readable if the writing is interrupted."""

from __future__ import annotations

import json
from collections.abc import Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinition

from cmpsp_ros.bags.custom_data import (
    PARAMETERS_KEY,
    RESTARTS_KEY,
    SOFTWARE_KEY,
    VERSION_KEY,
    own_version,
    plain,
    software_versions,
)
from cmpsp_ros.bags.definitions import jazzy, known_definition
from cmpsp_ros.bags.errors import BagError, UnknownTypeError
from cmpsp_ros.bags.storage.common import (
    METADATA,
    REFUSALS,
    UNFINISHED,
    FolderLock,
    Form,
    write_atomically,
)
from cmpsp_ros.bags.storage.rolling import RollingFiles

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path
    from typing import Self

    from rosbags.interfaces import Qos


class BagWriter:
    """A new bag: metadata version 9, ROS 2 Jazzy message definitions.

    As a context manager it always closes the bag, also after `KeyboardInterrupt`. Not thread-safe.

    Args:
        path: Folder of the bag; must not exist, missing parents are made.
        form: Format, compression, and when to begin a new file.

    Raises:
        BagError: The path exists or cannot be created.
    """

    def __init__(self, path: Path, form: Form | None = None) -> None:
        self.path = path
        form = form or Form()
        self._topics: dict[str, Connection] = {}
        self._parameters: dict[str, dict[str, object]] = {}
        self._restarts: dict[str, dict[int, dict[str, object]]] = {}
        self._custom = {
            VERSION_KEY: own_version(),
            SOFTWARE_KEY: json.dumps(software_versions()),
            PARAMETERS_KEY: '{}',
        }
        self._kept: dict[str, str] = {}
        self._closed = False
        if form.compressed and form.storage != 'mcap':
            raise BagError(f'{path}: only mcap can be compressed, not {form.storage}')
        try:
            path.mkdir(parents=True)
        except FileExistsError as error:
            msg = f'{path}: exists already, a new bag needs a path that does not exist'
            raise BagError(msg) from error
        except OSError as error:
            raise BagError(f'{path}: cannot create the bag: {error}') from error
        with self._refusing('cannot create the bag'):
            self._lock = FolderLock(path)
            self._files = RollingFiles(path, form, self._custom)
            self._lock.sync()

    @property
    def message_count(self) -> int:
        """Number of messages written."""
        return self._files.message_count

    def topic(
        self,
        name: str,
        msgtype: str,
        qos_profiles: Sequence[Qos] = (),
        definition: MessageDefinition | None = None,
    ) -> None:
        """Add a topic by its full name; its type is defined as in ROS 2 Jazzy if not otherwise.

        Raises:
            UnknownTypeError: No definition of the type is known; the bag goes on without it.
            BagError: The topic has been added already, the bag is closed, or the disk refuses.
        """
        self._check_open()
        if name in self._topics:
            raise BagError(f'{self.path}: topic {name} has been added already')
        known = known_definition(msgtype)
        chosen = definition or known
        if chosen is None:
            msg = f'{self.path}: topic {name} left out: no definition of its type {msgtype}'
            raise UnknownTypeError(msg)
        digest = jazzy().hash_rihs01(msgtype) if chosen == known else ''
        number, ext = len(self._topics) + 1, ConnectionExtRosbag2('cdr', list(qos_profiles))
        connection = Connection(number, name, msgtype, chosen, digest, 0, ext, self)
        with self._refusing('cannot write to the bag'):
            self._files.add(connection)
        self._topics[name] = connection

    def write(self, topic: str, stamp_ns: int, raw: bytes) -> None:
        """Write one serialised message (CDR), received at a time [ns], to a topic added before.

        Raises:
            BagError: Unknown topic, bag closed, or the disk refuses.
        """
        self._check_open()
        connection = self._topics.get(topic)
        if connection is None:
            raise BagError(f'{self.path}: write to topic {topic}, which has not been added')
        with self._refusing('cannot write to the bag'):
            self._files.write(connection, stamp_ns, raw)

    def flush(self) -> None:
        """Make everything written so far survive the end of the process, and a loss of power.

        Flushed messages can be recovered from a bag that was never closed.

        Raises:
            BagError: The bag is closed, or the disk refuses.
        """
        self._check_open()
        with self._refusing('cannot write to the bag'):
            if self._custom != self._kept:
                write_atomically(self.path / UNFINISHED, json.dumps(self._custom))
                self._kept = dict(self._custom)
            self._files.flush()
            self._lock.sync()

    def set_parameters(self, node_name: str, values: Mapping[str, object], since: int = 0) -> None:
        """Keep a node's parameters with the bag, in place of any kept for it and this time before.

        Args:
            node_name: Full name, as in `/guidance`.
            values: Plain values and sequences of them by name; floats read back bit for bit.
            since: Time of the restart with these values [ns]; 0 for the first start.

        Raises:
            BagError: The bag is closed, or a value is of another kind.
        """
        self._check_open()
        kept = {}
        for name, value in values.items():
            try:
                kept[name] = plain(value)
            except TypeError as error:
                raise BagError(f'{self.path}: parameter {name} of {node_name} {error}') from error
        if since == 0:
            self._parameters[node_name] = kept
            self._custom[PARAMETERS_KEY] = json.dumps(self._parameters)
        else:
            self._restarts.setdefault(node_name, {})[since] = kept
            listed = {node: sorted(each.items()) for node, each in self._restarts.items()}
            self._custom[RESTARTS_KEY] = json.dumps(listed)

    def set_custom(self, values: Mapping[str, str]) -> None:
        """Keep texts with the bag, by key; those of another bag that this one continues."""
        self._check_open()
        self._custom.update(values)

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
        try:
            self._close()
        finally:
            if (self.path / METADATA).exists():
                (self.path / UNFINISHED).unlink(missing_ok=True)
            self._lock.release()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        try:
            self.close()
        except BagError:
            # The error inside the block is the cause and must not be hidden.
            if kind is None:
                raise

    def _close(self) -> None:
        try:
            self._files.close()
        except REFUSALS as error:
            try:
                lost = self._files.make_room()
                self._files.close()
            except REFUSALS:
                self._files.abort()
                msg = f'{self.path}: cut off, without index and metadata: {error}'
                raise BagError(msg) from error
            msg = f'{self.path}: closed without its last {lost} messages: {error}'
            raise BagError(msg) from error

    def _check_open(self) -> None:
        if self._closed:
            raise BagError(f'{self.path}: the bag is closed')

    @contextmanager
    def _refusing(self, what: str) -> Iterator[None]:
        try:
            yield
        except REFUSALS as error:
            raise BagError(f'{self.path}: {what}: {error}') from error
