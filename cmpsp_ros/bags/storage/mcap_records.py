"""The records of an mcap file, read with bounded memory.

rosbags reads only files with an index, and trusts it; this module reads files that were cut off,
and checks an index. Format: mcap.dev/spec. A record is an opcode, its length and that many bytes.
"""

from __future__ import annotations

import os
import struct
from binascii import crc32
from typing import TYPE_CHECKING, NamedTuple

from rosbags.rosbag2 import ReaderError

from cmpsp_ros.bags.storage.limits import MAX_CHUNK, inflate

if TYPE_CHECKING:
    from collections.abc import Iterator
    from typing import BinaryIO

MAGIC = b'\x89MCAP0\r\n'
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, CHUNK_INDEX, STATISTICS = 2, 3, 4, 5, 6, 8, 11

LAST_OPCODE, FIRST_PRIVATE = 15, 128
_HEAD = struct.Struct('<BQ')
_MESSAGE = struct.Struct('<HIQQ')
_CHUNK = struct.Struct('<QQQI')
_MOST_HEAD = 64


class McapRecord(NamedTuple):
    """A record in a file.

    Attributes:
        opcode: Its kind.
        body: Offset of its content.
        size: Length of its content [bytes].
    """

    opcode: int
    body: int
    size: int

    @property
    def end(self) -> int:
        """Offset of the byte after it; beyond the end of the file when it is cut off."""
        return self.body + self.size


class McapMessage(NamedTuple):
    """A message record: number of its channel, stamp [ns], serialised message."""

    channel: int
    stamp: int
    raw: bytes


class ChunkHead(NamedTuple):
    """The header of a chunk.

    Attributes:
        start: First stamp [ns].
        end: Last stamp [ns].
        size: Length of its records, uncompressed [bytes].
        checksum: CRC-32 of its records; 0 for none.
        compression: `zstd`, `lz4`, or empty for none.
        compressed: Length of its records in the file [bytes].
    """

    start: int
    end: int
    size: int
    checksum: int
    compression: str
    compressed: int

    @classmethod
    def read(cls, fields: Fields) -> ChunkHead:
        """Read it.

        Raises:
            ReaderError: It is cut off, or the chunk is larger than `MAX_CHUNK`.
        """
        start, end, size, checksum = _CHUNK.unpack(fields.take(_CHUNK.size))
        head = cls(start, end, size, checksum, fields.text(), fields.uint(8))
        if head.size > MAX_CHUNK:
            raise ReaderError(f'chunk of {head.size} bytes, at most {MAX_CHUNK} are read')
        if not head.compression and head.compressed != head.size:
            msg = f'chunk of {head.size} bytes that takes {head.compressed} uncompressed'
            raise ReaderError(msg)
        return head


class Chunk(NamedTuple):
    """A chunk: its head, and the records in it, one after the other."""

    head: ChunkHead
    data: bytes


class Fields:
    """The fields of a record, read one after the other.

    Every method raises `ReaderError` where the content ends before the field does.
    """

    def __init__(self, content: bytes) -> None:
        self._content = content
        self._at = 0

    @property
    def left(self) -> int:
        """Number of bytes not read yet."""
        return len(self._content) - self._at

    def take(self, size: int) -> bytes:
        """The next bytes."""
        if size > self.left:
            raise ReaderError(f'a field of {size} bytes where {self.left} are left')
        self._at += size
        return self._content[self._at - size : self._at]

    def uint(self, size: int) -> int:
        """A number of so many bytes."""
        return int.from_bytes(self.take(size), 'little')

    def sized(self) -> bytes:
        """Bytes that follow their number."""
        return self.take(self.uint(4))

    def text(self) -> str:
        """Text that follows its length."""
        return self.sized().decode()

    def texts(self) -> dict[str, str]:
        """Texts by name."""
        fields, found = Fields(self.sized()), {}
        while fields.left:
            key = fields.text()
            found[key] = fields.text()
        return found


def records(file: BinaryIO, start: int, end: int) -> Iterator[McapRecord]:
    """Iterate over records from an offset on, without reading their content.

    The last may be cut off. What is no record at all ends the iteration.

    Args:
        file: Opened for reading; may be moved between two records.
        start: Offset of the first.
        end: Offset at which the last ends.
    """
    while start + _HEAD.size <= end:
        file.seek(start)
        opcode, size = _HEAD.unpack(file.read(_HEAD.size))
        if not (0 < opcode <= LAST_OPCODE or opcode >= FIRST_PRIVATE):
            return
        record = McapRecord(opcode, start + _HEAD.size, size)
        yield record
        start = record.end


def content(file: BinaryIO, record: McapRecord, limit: int = MAX_CHUNK + 4096) -> bytes:
    """Read the content of a record.

    Raises:
        ReaderError: It is longer than the limit, or cut off.
    """
    left = os.fstat(file.fileno()).st_size - record.body
    if record.size > min(limit, left):
        msg = f'record of {record.size} bytes at offset {record.body}, wanted at most '
        raise ReaderError(f'{msg}{min(limit, left)}')
    file.seek(record.body)
    return file.read(record.size)


def message(body: bytes) -> McapMessage:
    """Read a message record.

    Raises:
        ReaderError: It is cut off.
    """
    if len(body) < _MESSAGE.size:
        raise ReaderError(f'message record of {len(body)} bytes')
    channel, _, stamp, _ = _MESSAGE.unpack_from(body)
    return McapMessage(channel, stamp, body[_MESSAGE.size :])


def chunk_head(file: BinaryIO, record: McapRecord) -> ChunkHead:
    """Read the head of a chunk record only.

    Raises:
        ReaderError: It is cut off, or larger than `MAX_CHUNK`.
    """
    return ChunkHead.read(Fields(content(file, record._replace(size=min(record.size, _MOST_HEAD)))))


def chunk(body: bytes, *, partly: bool = False) -> Chunk:
    """Uncompress a chunk record.

    Args:
        body: Content of the record.
        partly: Whether it may be cut off; the result then has the beginning of the whole.

    Raises:
        ReaderError: Damaged, cut off, or larger than `MAX_CHUNK`.
    """
    fields = Fields(body)
    head = ChunkHead.read(fields)
    data = fields.take(min(head.compressed, fields.left) if partly else head.compressed)
    inflated = inflate(data, head.compression, head.size, partly=partly)
    is_whole = len(inflated) == head.size and head.checksum in {0, crc32(inflated)}
    if not partly and not is_whole:
        raise ReaderError(f'chunk of {len(inflated)} bytes is not what it was when it was written')
    return Chunk(head, inflated)


def inner(inflated: bytes) -> Iterator[tuple[int, bytes]]:
    """Iterate over the whole records in an uncompressed chunk, or its beginning.

    Yields:
        Opcode and content.
    """
    at = 0
    while at + _HEAD.size <= len(inflated):
        opcode, size = _HEAD.unpack_from(inflated, at)
        at += _HEAD.size
        if size > len(inflated) - at:
            return
        yield opcode, inflated[at : at + size]
        at += size
