"""Checks of untrusted mcap files: sizes and offsets, before rosbags reads them.

The index determines what rosbags reads, decompresses and holds at a time. So the index is checked,
and each chunk against it.
"""

from __future__ import annotations

import heapq
from typing import TYPE_CHECKING

from rosbags.rosbag2 import ReaderError

from cmpsp_ros.bags.storage.limits import (
    MAX_CHUNK,
    MAX_CHUNKS,
    MAX_HELD,
    MAX_METADATA,
    MAX_SUMMARY,
    MAX_TOPICS,
    check_yaml,
    inflated_allowed,
)
from cmpsp_ros.bags.storage.mcap_records import (
    CHANNEL,
    CHUNK,
    CHUNK_INDEX,
    FOOTER,
    MAGIC,
    SCHEMA,
    STATISTICS,
    ChunkHead,
    Fields,
    McapRecord,
    chunk,
    chunk_head,
    content,
    records,
)

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping
    from pathlib import Path
    from typing import BinaryIO

_MAX_DEFINITION = 1 << 20
_END_SIZE = 37
_PROFILES = 'offered_qos_profiles'

WITHOUT_INDEX = 'without an index, as a recording that was cut off; `cmpsp recover` makes one'


def check_mcap(path: Path) -> None:
    """Make sure that a file can be read in bounded memory and time.

    Raises:
        ReaderError: Not an mcap file, cut off, damaged, or beyond what is read.
    """
    with path.open('rb') as file:
        size = path.stat().st_size
        begin, start = _data_section(file, path.name, size)
        chunks, is_complete = _check_summary(file, path.name, start, size - _END_SIZE)
        if chunks:
            _check_chunks(file, chunks, size)
        elif is_complete:
            _check_records(file, path.name, begin, start)
        else:
            raise ReaderError(WITHOUT_INDEX)


def _data_section(file: BinaryIO, name: str, size: int) -> tuple[int, int]:
    """Where the data begin, and the index after them."""
    if file.read(len(MAGIC)) != MAGIC:
        raise ReaderError(f'{name} is not an mcap file')
    file.seek(max(0, size - _END_SIZE))
    end = file.read()
    start = int.from_bytes(end[9:17], 'little')
    header = next(records(file, len(MAGIC), size), None)
    is_whole = end.endswith(MAGIC) and end[0] == FOOTER and header is not None
    if not is_whole or header is None or not header.end <= start <= size - _END_SIZE:
        raise ReaderError(f'{name} is {WITHOUT_INDEX}')
    content(file, header, _MAX_DEFINITION)
    if size - start > MAX_SUMMARY:
        raise ReaderError(f'index of {size - start} bytes, at most {MAX_SUMMARY} are read')
    return header.end, start


def _check_summary(
    file: BinaryIO, name: str, start: int, end: int
) -> tuple[dict[int, ChunkHead], bool]:
    """Heads of the chunks by offset, as the index has them; whether it does without chunks."""
    topics = profiles = schemas = 0
    count: int | None = None
    chunks: dict[int, ChunkHead] = {}
    for record in records(file, start, end):
        body = content(file, record, MAX_SUMMARY)
        start = record.end
        if record.opcode == CHANNEL:
            topics += 1
            profiles += _check_channel(body)
        elif record.opcode == SCHEMA:
            schemas += 1
            if record.size > _MAX_DEFINITION:
                raise ReaderError(f'message definition of {record.size} bytes')
        elif record.opcode == CHUNK_INDEX:
            offset, head = _indexed(Fields(body))
            if offset in chunks:
                raise ReaderError('index that names a chunk twice')
            chunks[offset] = head
        elif record.opcode == STATISTICS:
            count = Fields(body).uint(8)
        if topics > MAX_TOPICS or profiles > MAX_METADATA or len(chunks) > MAX_CHUNKS:
            raise ReaderError(
                f'more than {MAX_TOPICS} topics, {MAX_METADATA} bytes of QoS profiles'
                f' or {MAX_CHUNKS} chunks'
            )
    if start != end:
        raise ReaderError(f'{name} has a damaged index, at byte {start}')
    return chunks, count == 0 or (count is not None and schemas > 0)


def _indexed(fields: Fields) -> tuple[int, ChunkHead]:
    start, end, offset, _ = (fields.uint(8) for _ in range(4))
    fields.sized()
    fields.uint(8)
    compression, compressed, size = fields.text(), fields.uint(8), fields.uint(8)
    return offset, ChunkHead(start, end, size, 0, compression, compressed)


def _check_chunks(file: BinaryIO, chunks: Mapping[int, ChunkHead], size: int) -> None:
    """Make sure that each chunk matches the index, and bound their total size."""
    inflated, allowed = sum(each.size for each in chunks.values()), inflated_allowed(size)
    if inflated > allowed:
        raise ReaderError(f'chunks of {inflated} bytes uncompressed, at most {allowed} are read')
    _check_overlap(chunks.values())
    for offset, head in chunks.items():
        record = next(records(file, offset, size), McapRecord(0, 0, 0))
        if record.opcode != CHUNK:
            raise ReaderError(f'no chunk at offset {offset}')
        # What is not compressed is as large as it says, and need not be read twice.
        found = chunk(content(file, record)).head if head.compression else chunk_head(file, record)
        if found._replace(checksum=0) != head:
            raise ReaderError(f'chunk at offset {offset} is not the one that was indexed')


def _check_overlap(heads: Iterable[ChunkHead]) -> None:
    """Bound the size of chunks that overlap in time: they are held together to be sorted."""
    held, ends = 0, list[tuple[int, int]]()
    for head in sorted(heads):
        while ends and ends[0][0] < head.start:
            held -= heapq.heappop(ends)[1]
        heapq.heappush(ends, (head.end, head.size))
        held += head.size
        if held > MAX_HELD:
            raise ReaderError(f'more than {MAX_HELD} bytes of messages overlap in time')


def _check_records(file: BinaryIO, name: str, begin: int, end: int) -> None:
    """Make sure of the records of a file without an index of chunks."""
    inflated, allowed = 0, inflated_allowed(end)
    for record in records(file, begin, end):
        begin = record.end
        if record.opcode == CHUNK:
            inflated += len(chunk(content(file, record)).data)
        if inflated > allowed or (record.size > MAX_CHUNK and record.opcode != CHUNK):
            msg = f'record of {record.size} bytes, or over {allowed} bytes uncompressed'
            raise ReaderError(msg)
    if begin != end:
        raise ReaderError(f'{name} is damaged at byte {begin}')


def _check_channel(body: bytes) -> int:
    """Check the QoS profiles of a channel; returns their length."""
    fields = Fields(body)
    fields.take(4)
    fields.text()
    fields.text()
    text = fields.texts().get(_PROFILES, '')
    if len(text) > MAX_METADATA:
        raise ReaderError(f'QoS profiles of {len(text)} bytes')
    check_yaml(text)
    return len(text)
