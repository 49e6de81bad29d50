"""Mcap files of unknown origin: checks before rosbags reads them, and recovery of their messages.

rosbags scans files without an index and compares sizes and checksums of chunks; but it allocates
as much as a file says, uncompresses as much as there is (its table of decompressors is bounded
here), and refuses files that were cut off. Format: mcap.dev/spec; a record is an opcode, its length
and that many bytes.
"""

import heapq
import struct
from binascii import crc32
from collections.abc import Iterable, Iterator
from io import BytesIO
from pathlib import Path
from typing import BinaryIO, NamedTuple

from rosbags.interfaces import MessageDefinition
from rosbags.rosbag2 import ReaderError
from rosbags.rosbag2.storage_mcap import DECOMPRESSORS, read_bytes, read_exact, read_string

from cmpsp_ros.bags.storage import limits
from cmpsp_ros.bags.storage.common import Found, FoundTopic, Remark, read_definition, read_profiles

MAGIC = b'\x89MCAP0\r\n'
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, CHUNK_INDEX = 2, 3, 4, 5, 6, 8

_LAST_OPCODE, _FIRST_PRIVATE = 15, 128
_RECORD = struct.Struct('<BQ')
_MESSAGE = struct.Struct('<HIQQ')
_CHUNK = struct.Struct('<QQQI')
_INDEX = struct.Struct('<QQQQ')
_SIZES = struct.Struct('<QQ')
_UINT16, _UINT64 = 2, 8  # sizes of numbers [bytes]

_END_SIZE = 37
_MAX_RECORD = limits.MAX_CHUNK + 4096
_MAX_DEFINITION = 1 << 20
_PROFILES = 'offered_qos_profiles'

DECOMPRESSORS |= {
    'lz4': lambda data, size: limits.inflate(data, 'lz4', min(size, limits.MAX_CHUNK)),
    'zstd': lambda data, size: limits.inflate(data, 'zstd', min(size, limits.MAX_CHUNK)),
}


class McapRecord(NamedTuple):
    """A record in a file: its kind, and offset and length of its content [bytes]."""

    opcode: int
    body: int
    size: int

    @property
    def end(self) -> int:
        """Offset of the byte after it; beyond the end of the file if truncated."""
        return self.body + self.size


class ChunkHead(NamedTuple):
    """The header of a chunk: stamps [ns], and its records uncompressed and in the file [bytes]."""

    start: int
    end: int
    size: int
    checksum: int  # CRC-32, or 0 for none
    compression: str  # `zstd`, `lz4`, or empty for none
    compressed: int


def records(file: BinaryIO, start: int, end: int) -> Iterator[McapRecord]:
    """Records between two offsets, up to invalid data or a truncated one, without their content."""
    while start + _RECORD.size <= end:
        file.seek(start)
        opcode, size = _RECORD.unpack(file.read(_RECORD.size))
        if not (0 < opcode <= _LAST_OPCODE or opcode >= _FIRST_PRIVATE):
            return
        record = McapRecord(opcode, start + _RECORD.size, size)
        yield record
        start = record.end


def content(file: BinaryIO, record: McapRecord, end: int, limit: int = _MAX_RECORD) -> BytesIO:
    """Read the content of a record."""
    most = min(limit, end - record.body)
    if record.size > most:
        raise ReaderError(
            f'record of {record.size} bytes at offset {record.body}, wanted at most {most}'
        )
    file.seek(record.body)
    return BytesIO(file.read(record.size))


def read_chunk(body: BytesIO, *, truncated: bool = False) -> tuple[ChunkHead, bytes]:
    """Uncompress a chunk record; a truncated one yields its first records."""
    start, end, size, checksum = _CHUNK.unpack(read_exact(body, _CHUNK.size))
    head = ChunkHead(start, end, size, checksum, read_string(body), _number(body, _UINT64))
    _check_head(head)
    data = body.read(head.compressed) if truncated else read_exact(body, head.compressed)
    inflated = limits.inflate(data, head.compression, head.size, truncated=truncated)
    is_sound = len(inflated) == head.size and head.checksum in {0, crc32(inflated)}
    if not (truncated or is_sound):
        raise ReaderError(f'chunk of {len(inflated)} bytes is not what it was when it was written')
    return head, inflated


def _check_head(head: ChunkHead) -> None:
    if head.size > limits.MAX_CHUNK:
        raise ReaderError(f'chunk of {head.size} bytes, at most {limits.MAX_CHUNK} are read')
    if not head.compression and head.compressed != head.size:
        raise ReaderError(f'chunk of {head.size} bytes that takes {head.compressed} uncompressed')


def _number(body: BytesIO, size: int) -> int:
    return int.from_bytes(read_exact(body, size), 'little')


def _channel(body: BytesIO) -> tuple[int, int, str, str, str]:
    """Number, number of the schema, topic, encoding, and QoS profiles of a channel record."""
    number, schema = _number(body, _UINT16), _number(body, _UINT16)
    name, encoding, metadata = read_string(body), read_string(body), BytesIO(read_bytes(body))
    values = {}
    while metadata.tell() < len(metadata.getbuffer()):
        key = read_string(metadata)
        values[key] = read_string(metadata)
    return number, schema, name, encoding, values.get(_PROFILES, '')


def check_mcap(path: Path) -> None:
    """Check that rosbags can read a file in bounded memory and time."""
    size = path.stat().st_size
    with path.open('rb') as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise ReaderError(f'{path.name} is not an mcap file')
        file.seek(max(0, size - _END_SIZE))
        end = file.read()
        header = next(records(file, len(MAGIC), size), None)
        if header is None or end[0] != FOOTER or not end.endswith(MAGIC):
            msg = 'without an index, as a recording that was cut off; `cmpsp recover` makes one'
            raise ReaderError(f'{path.name} is {msg}')
        content(file, header, size, _MAX_DEFINITION)
        footer = size - _END_SIZE
        start = int.from_bytes(end[9:17], 'little') or footer
        if not header.end <= start or footer - start > limits.MAX_SUMMARY:
            msg = f'{path.name} has an index of {size - start} bytes, at most {limits.MAX_SUMMARY}'
            raise ReaderError(f'{msg} are read')
        index = _Checker(path.name, limits.inflated_allowed(size))
        index.check(file, start, footer)
        _check_overlap(index.chunks.values())
        if any(offset + head.compressed > size for offset, head in index.chunks.items()):
            raise ReaderError(f'{path.name} has an index of chunks beyond its end')
        if not index.chunks:
            _Checker(path.name, limits.inflated_allowed(size)).check(file, header.end, start)


class _Checker:
    """Checks of records that rosbags reads one after the other: an index, or a file without one.

    `chunks` has the heads of chunks by offset, as the index has them.
    """

    def __init__(self, name: str, allowed: int) -> None:
        self._name, self._allowed = name, allowed
        self._topics = self._profiles = self._inflated = 0
        self.chunks: dict[int, ChunkHead] = {}

    def check(self, file: BinaryIO, start: int, end: int, *, in_chunk: bool = False) -> None:
        """Check the records between two offsets; raises a `ReaderError`."""
        for record in records(file, start, end):
            start = record.end
            if record.opcode == CHUNK and not in_chunk:
                data = read_chunk(content(file, record, end))[1]
                self._inflated += len(data)
                self.check(BytesIO(data), 0, len(data), in_chunk=True)
            elif record.opcode == CHANNEL:
                self._topics += 1
                text = _channel(content(file, record, end))[-1]
                self._profiles += len(text)
                limits.check_yaml(text if len(text) <= limits.MAX_METADATA else '')
            elif record.opcode == CHUNK_INDEX:
                self._index(content(file, record, end))
            elif record.size > (_MAX_DEFINITION if record.opcode == SCHEMA else limits.MAX_CHUNK):
                raise ReaderError(f'record of {record.size} bytes at offset {record.body}')
            self._check_totals()
        if start != end:
            raise ReaderError(f'{self._name} is damaged at byte {start}')

    def _index(self, body: BytesIO) -> None:
        start, end, offset, _ = _INDEX.unpack(read_exact(body, _INDEX.size))
        read_bytes(body)
        _number(body, _UINT64)
        compression = read_string(body)
        compressed, size = _SIZES.unpack(read_exact(body, _SIZES.size))
        if offset in self.chunks:
            raise ReaderError('index that names a chunk twice')
        self.chunks[offset] = ChunkHead(start, end, size, 0, compression, compressed)
        _check_head(self.chunks[offset])
        self._inflated += size

    def _check_totals(self) -> None:
        if self._inflated > self._allowed:
            msg = f'chunks of {self._inflated} bytes uncompressed, at most {self._allowed} are read'
            raise ReaderError(msg)
        over = self._topics > limits.MAX_TOPICS or self._profiles > limits.MAX_METADATA
        if over or len(self.chunks) > limits.MAX_CHUNKS:
            raise ReaderError(
                f'more than {limits.MAX_TOPICS} topics, {limits.MAX_METADATA} bytes of QoS profiles'
                f' or {limits.MAX_CHUNKS} chunks'
            )


def _check_overlap(heads: Iterable[ChunkHead]) -> None:
    """Bound the size of chunks that overlap in time: they are held together to be sorted."""
    held, ends = 0, list[tuple[int, int]]()
    for head in sorted(heads):
        while ends and ends[0][0] < head.start:
            held -= heapq.heappop(ends)[1]
        heapq.heappush(ends, (head.end, head.size))
        held += head.size
        if held > limits.MAX_HELD:
            raise ReaderError(f'more than {limits.MAX_HELD} bytes of messages overlap in time')


def salvage_mcap(path: Path, _folder: Path, remark: Remark) -> Iterator[Found]:
    """Topics and messages of a file that may be cut off; each damaged record is left out."""
    end = path.stat().st_size
    with path.open('rb') as file:
        if file.read(len(MAGIC)) == MAGIC:
            yield from _Salvage(path.name, end, remark).read(file, len(MAGIC), end)
        else:
            remark(f'{path.name}: not an mcap file')


class _Salvage:
    """Schemas and channels found so far in an mcap file, by number."""

    def __init__(self, name: str, size: int, remark: Remark) -> None:
        self._name, self._remark, self._allowed = name, remark, limits.inflated_allowed(size)
        self._schemas: dict[int, tuple[str, MessageDefinition | None]] = {}
        self._topics: dict[int, FoundTopic] = {}
        self._inflated = 0

    def read(
        self, file: BinaryIO, start: int, end: int, *, in_chunk: bool = False
    ) -> Iterator[Found]:
        """Contents of the records between two offsets of a file, or of an uncompressed chunk."""
        last = McapRecord(0, start, 0)
        for last in records(file, start, end):
            try:
                found = self._contents(file, last, end, in_chunk=in_chunk)
            except (ReaderError, ValueError, LookupError, TypeError) as error:
                place = f'byte {last.body}{" of a chunk" * in_chunk}'
                self._remark(f'{self._name}: left out a record at {place}: {error}')
            else:
                yield from found
        if last.opcode != FOOTER and not in_chunk:
            place = f'byte {min(last.end, end)} of {end}'
            self._remark(f'{self._name}: cut off or damaged at {place}')

    def _contents(
        self, file: BinaryIO, record: McapRecord, end: int, *, in_chunk: bool
    ) -> Iterable[Found]:
        truncated = record.end > end
        if record.opcode == CHUNK and not in_chunk:
            rest = record._replace(size=min(record.size, end - record.body))
            _, data = read_chunk(content(file, rest, end), truncated=truncated)
            self._inflated += len(data)
            if self._inflated > self._allowed:
                raise ReaderError(f'more than {self._allowed} bytes uncompressed')
            return self.read(BytesIO(data), 0, len(data), in_chunk=True)
        if truncated or record.opcode not in {SCHEMA, CHANNEL, MESSAGE}:
            return ()
        body = content(file, record, end)
        if record.opcode == MESSAGE:
            channel, _, stamp, _ = _MESSAGE.unpack(read_exact(body, _MESSAGE.size))
            topic = self._topics.get(channel)
            return [] if topic is None else [(topic, stamp, body.read())]
        if record.opcode == SCHEMA:
            number, name, encoding = _number(body, _UINT16), read_string(body), read_string(body)
            self._schemas[number] = name, read_definition(encoding, read_string(body))
            return ()
        number, schema, name, encoding, profiles = _channel(body)
        if number in self._topics or len(self._topics) >= limits.MAX_TOPICS:
            return ()
        if encoding != 'cdr':
            raise ReaderError(f'topic {name} is not in CDR')
        topic = FoundTopic(name, *self._schemas[schema], read_profiles(profiles))
        self._topics[number] = topic
        return [topic]
