"""Mcap storage with checksums that survives a full disk.

rosbags' writer does the format. It loses the chunk that a full disk refuses, writes its index after
half a chunk, and leaves all checksums empty; this module overrides its writing of a chunk.
"""

import os
from binascii import crc32
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import BinaryIO, NamedTuple

from rosbags.rosbag2.enums import CompressionMode
from rosbags.rosbag2.storage_mcap import McapWriter

from cmpsp_ros.bags.storage.common import NO_MESSAGE_YET

# Offsets in a chunk record and in the end of a file (mcap.dev/spec).
_CHUNK_CRC = 1 + 8 + 8 + 8 + 8
_FOOTER_SIZE = 1 + 8 + 20 + 8
_LEVEL = 6  # of zstd: a twentieth smaller than its default, in twice the time
_INDEX_START, _INDEX_CRC = 1 + 8, 1 + 8 + 8 + 8


class _WrittenChunk(NamedTuple):
    """A complete chunk in the file: its offset, messages by channel, first and last stamp."""

    offset: int
    counts: Mapping[int, int]
    start: int
    end: int


class McapStorage(McapWriter):
    """A new file, by zstd if compressed, which ends in a complete chunk between calls.

    When the disk refuses a chunk, or the index at the end, an `OSError` is raised, the file is
    cut back to its last complete chunk and the refused messages stay in memory: the same call
    can be repeated.
    """

    def __init__(self, path: Path, *, compressed: bool = False) -> None:
        super().__init__(
            path.parent, CompressionMode.STORAGE if compressed else CompressionMode.NONE
        )
        if compressed:
            self.compressor = partial(self.compressor, level=_LEVEL)  # type: ignore[call-arg]
        # The base names the file after its folder.
        self.path = self.path.rename(path)
        try:
            self.bio.flush()
        except OSError:
            # Not even a header: no file at all is better.
            self.path.unlink()
            raise
        self._end = self.bio.tell()
        self._written: list[_WrittenChunk] = []

    @property
    def size(self) -> int:
        """Size of the file so far, the pending chunk included [bytes]."""
        return self._end + self.chunk.bio.tell()

    def flush(self) -> None:
        """Make everything written so far survive a loss of power."""
        if self.chunk.msgs:
            self.close_chunk()
        os.fsync(self.bio.fileno())

    def close_chunk(self) -> None:
        """Write out the pending chunk; if the disk refuses, file and chunk stay as before."""
        pending, count = self.chunk, len(self.chunks)
        try:
            super().close_chunk()
            _patch(self.bio, self._end + _CHUNK_CRC, crc32(pending.bio.getbuffer()))
            self.bio.flush()
        except OSError:
            self.chunk = pending
            del self.chunks[count:]
            self._cut_back()
            raise
        counts = {channel: len(messages) for channel, messages in pending.msgs.items()}
        times = pending.message_start_time, pending.message_end_time
        self._written.append(_WrittenChunk(self._end, counts, *times))
        self._end = self.bio.tell()

    def close(self, version: int, metadata: str) -> None:
        """Write pending chunk, metadata and index, and close the file."""
        try:
            self.flush()
            super().close(version, metadata)
            self._write_index_checksum()
        except OSError:
            self._cut_back()
            raise

    def make_room(self, metadata_size: int) -> None:
        """Drop chunks from the end until index and metadata, of this size twice [bytes], fit."""
        self.chunk.msgs.clear()
        self.chunk.bio.seek(0)
        self.chunk.bio.truncate()
        end, written = self._end, self._written
        texts = sum(len(each.data.encode()) for each in self.schemas)
        # The definitions and the channels' metadata are repeated in the index.
        wanted = 3 * metadata_size + texts + sum(each.tell() for each in self.chunks)
        while written and end - self._end < wanted:
            self._end = written.pop().offset
            self.chunks.pop()
        self.channel_stats = dict.fromkeys(self.channel_stats, 0)
        for chunk in written:
            for channel, count in chunk.counts.items():
                self.channel_stats[channel] += count
        self.message_start_time = min((each.start for each in written), default=NO_MESSAGE_YET)
        self.message_end_time = max((each.end for each in written), default=0)
        self._cut_back()

    def _write_index_checksum(self) -> None:
        with self.path.open('r+b') as file:
            footer = file.seek(-_FOOTER_SIZE, os.SEEK_END)
            file.seek(footer + _INDEX_START)
            start = file.seek(int.from_bytes(file.read(8), 'little'))
            _patch(file, footer + _INDEX_CRC, crc32(file.read(footer + _INDEX_CRC - start)))
            file.flush()
            os.fsync(file.fileno())

    def _cut_back(self) -> None:
        os.truncate(self.path, self._end)
        file = os.fdopen(os.open(self.path, os.O_WRONLY), 'wb')
        file.seek(0, os.SEEK_END)
        if not self.bio.closed:
            # The refused bytes are still in the old buffer, which closing would write again.
            with Path(os.devnull).open('wb') as nowhere:
                os.dup2(nowhere.fileno(), self.bio.fileno())
            self.bio.close()
        self.bio = file


def _patch(file: BinaryIO, offset: int, checksum: int) -> None:
    file.seek(offset)
    file.write(checksum.to_bytes(4, 'little'))
    file.seek(0, os.SEEK_END)
