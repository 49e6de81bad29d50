"""Mcap files of anybody's making, read in bounded memory and time."""

from __future__ import annotations

from collections import deque
from heapq import heappop, heappush
from typing import TYPE_CHECKING

from rosbags.rosbag2 import ReaderError
from rosbags.rosbag2.storage_mcap import McapReader

from cmpsp_ros.bags.storage.limits import (
    MAX_HELD,
    MAX_METADATA,
    MAX_SUMMARY,
    MAX_TOPICS,
    check_file,
    check_yaml,
    inflated_allowed,
)
from cmpsp_ros.bags.storage.mcap_records import (
    CHANNEL,
    CHUNK,
    FOOTER,
    MAGIC,
    MESSAGE,
    SCHEMA,
    Fields,
    Message,
    Record,
    chunk,
    content,
    inner,
    message,
    records,
)

if TYPE_CHECKING:
    from collections.abc import Collection, Generator, Iterator
    from pathlib import Path
    from typing import BinaryIO

    from rosbags.interfaces import Connection
    from rosbags.rosbag2.storage_mcap import ChunkInfo

_MAX_DEFINITION = 1 << 20
_END_SIZE = 37
_PROFILES = 'offered_qos_profiles'

WITHOUT_INDEX = 'without an index, as a recording that was cut off; `cmpsp recover` makes one'


class GuardedMcap(McapReader):
    """rosbags' reader, with its sizes checked first, and messages merged in bounded memory."""

    path: Path

    def open(self) -> None:
        """Read the index.

        Raises:
            ReaderError: Not an mcap file, cut off, damaged, or beyond what is read.

        """
        check_file(self.path)
        self._check_summary()
        super().open()
        try:
            self._check_chunks()
        except BaseException:
            self.close()
            raise

    def meta_scan(self) -> None:
        """Do without what the index does not hold.

        Raises:
            ReaderError: There are messages it should hold.

        """
        if self.statistics is None or self.statistics.message_count:
            raise ReaderError(WITHOUT_INDEX)

    def messages(
        self, connections: Collection[Connection], start: int | None = None, stop: int | None = None
    ) -> Generator[tuple[Connection, int, bytes], None, None]:
        """Iterate over messages in order of time.

        Args:
            connections: Topics wanted.
            start: First stamp [ns].
            stop: Stamp before which to end [ns].

        Yields:
            Topic, stamp [ns] and serialised message.

        Raises:
            ReaderError: Damaged, or too much of it overlaps in time.

        """
        wanted = {each.id: each for each in connections}
        for found in self._merged(wanted) if self.chunks else self._unchunked(wanted):
            if (start is None or start <= found.stamp) and (stop is None or found.stamp < stop):
                yield wanted[found.channel], found.stamp, found.raw

    @property
    def _file(self) -> BinaryIO:
        if self.bio is None:
            msg = f'{self.path.name} is closed'
            raise ReaderError(msg)
        return self.bio

    def _check_summary(self) -> None:
        with self.path.open('rb') as file:
            size = self.path.stat().st_size
            if file.read(len(MAGIC)) != MAGIC:
                msg = f'{self.path.name} is not an mcap file'
                raise ReaderError(msg)
            file.seek(max(0, size - _END_SIZE))
            end = file.read()
            if not end.endswith(MAGIC) or end[0] != FOOTER:
                msg = f'{self.path.name} is {WITHOUT_INDEX}'
                raise ReaderError(msg)
            start = int.from_bytes(end[9:17], 'little')
            header = next(records(file, len(MAGIC), size), None)
            if header is None or not header.end <= start <= size - _END_SIZE:
                msg = f'{self.path.name} is {WITHOUT_INDEX}'
                raise ReaderError(msg)
            content(file, header, _MAX_DEFINITION)
            if size - start > MAX_SUMMARY:
                msg = f'index of {size - start} bytes, at most {MAX_SUMMARY} are read'
                raise ReaderError(msg)
            topics = profiles = 0
            for record in records(file, start, size - _END_SIZE):
                body = content(file, record, MAX_SUMMARY)
                start = record.end
                if record.opcode == CHANNEL:
                    topics += 1
                    profiles += _check_channel(body)
                elif record.opcode == SCHEMA and record.size > _MAX_DEFINITION:
                    msg = f'message definition of {record.size} bytes'
                    raise ReaderError(msg)
                if topics > MAX_TOPICS or profiles > MAX_METADATA:
                    msg = f'more than {MAX_TOPICS} topics or {MAX_METADATA} bytes of QoS profiles'
                    raise ReaderError(msg)
            if start != size - _END_SIZE:
                msg = f'{self.path.name} has a damaged index, at byte {start}'
                raise ReaderError(msg)

    def _check_chunks(self) -> None:
        starts = {each.chunk_start_offset for each in self.chunks}
        inflated = sum(each.uncompressed_size for each in self.chunks)
        allowed = inflated_allowed(self.path.stat().st_size)
        if len(starts) < len(self.chunks):
            msg = 'index that names a chunk twice'
            raise ReaderError(msg)
        if inflated > allowed:
            msg = f'chunks of {inflated} bytes uncompressed, at most {allowed} are read'
            raise ReaderError(msg)

    def _unchunked(self, wanted: Collection[int]) -> Iterator[Message]:
        file, before = self._file, 0
        for record in records(file, self.data_start, self.data_end):
            if record.opcode != MESSAGE:
                continue
            found = message(content(file, record))
            if found.channel not in wanted:
                continue
            if found.stamp < before:
                msg = 'messages neither indexed nor in order of time'
                raise ReaderError(msg)
            before = found.stamp
            yield found

    def _merged(self, wanted: Collection[int]) -> Iterator[Message]:
        chosen = [each for each in self.chunks if any(map(each.channel_count.get, wanted))]
        waiting = deque(sorted(chosen, key=lambda each: each.message_start_time))
        held: list[tuple[int, int, int, Message]] = []
        size = 0
        while waiting or held:
            while waiting and (not held or waiting[0].message_start_time <= held[0][0]):
                info = waiting.popleft()
                for number, found in enumerate(self._chunk(info, wanted)):
                    size += len(found.raw)
                    # Those of one stamp stay in the order of writing.
                    heappush(held, (found.stamp, info.chunk_start_offset, number, found))
                if size > MAX_HELD:
                    msg = f'more than {MAX_HELD} bytes of messages overlap in time'
                    raise ReaderError(msg)
            if held:
                *_, found = heappop(held)
                size -= len(found.raw)
                yield found

    def _chunk(self, info: ChunkInfo, wanted: Collection[int]) -> Iterator[Message]:
        file, end = self._file, self.path.stat().st_size
        record = next(records(file, info.chunk_start_offset, end), Record(0, 0, 0))
        if record.opcode != CHUNK:
            msg = f'no chunk at offset {info.chunk_start_offset}'
            raise ReaderError(msg)
        inflated = chunk(content(file, record))
        if len(inflated) != info.uncompressed_size:
            msg = f'chunk at offset {info.chunk_start_offset} is not the one that was indexed'
            raise ReaderError(msg)
        for opcode, body in inner(inflated):
            if opcode != MESSAGE:
                continue
            found = message(body)
            if found.channel not in wanted:
                continue
            if found.stamp < info.message_start_time:
                msg = f'message at {found.stamp} ns in a chunk that begins later'
                raise ReaderError(msg)
            yield found


def _check_channel(body: bytes) -> int:
    """Check the QoS profiles of a channel; returns their length."""
    fields = Fields(body)
    fields.take(4)
    fields.text()
    fields.text()
    text = fields.texts().get(_PROFILES, '')
    if len(text) > MAX_METADATA:
        msg = f'QoS profiles of {len(text)} bytes'
        raise ReaderError(msg)
    check_yaml(text)
    return len(text)
