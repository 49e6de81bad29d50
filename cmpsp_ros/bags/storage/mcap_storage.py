"""Mcap storage that takes back what the disk refused."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from rosbags.rosbag2.enums import CompressionMode
from rosbags.rosbag2.storage_mcap import McapWriter

from cmpsp_ros.bags.storage.form import NO_MESSAGE_YET

if TYPE_CHECKING:
    from collections.abc import Mapping


class _Whole(NamedTuple):
    """A chunk that is in the file: where it begins, and what is in it."""

    offset: int
    counts: Mapping[int, int]
    start: int
    end: int


class McapStorage(McapWriter):
    """A file that ends in a whole chunk whenever no call is under way.

    When the disk refuses a chunk, or the index at the end, the file is cut back to its last whole
    chunk and the refused messages stay in memory: the same call can be made again.

    Args:
        path: The new file.
        compressed: Whether chunks are compressed by zstd.

    Raises:
        OSError: It cannot be created.

    """

    def __init__(self, path: Path, *, compressed: bool = False) -> None:
        super().__init__(
            path.parent, CompressionMode.STORAGE if compressed else CompressionMode.NONE
        )
        # The base names the file after its folder.
        self.path = self.path.rename(path)
        try:
            self.bio.flush()
        except OSError:
            # Not even a header: no file at all is better.
            self.path.unlink()
            raise
        self._end = self.bio.tell()
        self._written: list[_Whole] = []

    @property
    def size(self) -> int:
        """Size of the file so far, the pending chunk included [bytes]."""
        return self._end + self.chunk.bio.tell()

    def flush(self) -> None:
        """Have everything written so far survive a loss of power.

        Raises:
            OSError: The disk refuses.

        """
        if self.chunk.msgs:
            self.close_chunk()
        os.fsync(self.bio.fileno())

    def close_chunk(self) -> None:
        """Write the pending chunk out.

        Raises:
            OSError: The disk refuses; file and pending chunk are as before.

        """
        pending, written = self.chunk, len(self.chunks)
        try:
            super().close_chunk()
            self.bio.flush()
        except OSError:
            self.chunk = pending
            del self.chunks[written:]
            self._cut_back()
            raise
        counts = {channel: len(messages) for channel, messages in pending.msgs.items()}
        times = pending.message_start_time, pending.message_end_time
        self._written.append(_Whole(self._end, counts, *times))
        self._end = self.bio.tell()

    def close(self, version: int, metadata: str) -> None:
        """Write pending chunk, metadata and index, and close the file.

        Raises:
            OSError: The disk refuses; the file ends in its last whole chunk.

        """
        try:
            self.flush()
            super().close(version, metadata)
        except OSError:
            self._cut_back()
            raise

    def make_room(self, metadata_size: int) -> None:
        """Forget the pending chunk, and chunks from the end until index and metadata fit.

        Args:
            metadata_size: Room the metadata takes, in this file and once more beside it [bytes].

        """
        self.chunk.msgs.clear()
        self.chunk.bio.seek(0)
        self.chunk.bio.truncate()
        end = self._end
        texts = sum(len(each.data.encode()) for each in self.schemas)
        # The definitions and the channels' metadata are repeated in the index.
        wanted = 3 * metadata_size + texts + sum(each.tell() for each in self.chunks)
        while self._written and end - self._end < wanted:
            self._end = self._written.pop().offset
            self.chunks.pop()
        self._count_again()
        self._cut_back()

    def _count_again(self) -> None:
        self.channel_stats = dict.fromkeys(self.channel_stats, 0)
        for whole in self._written:
            for channel, count in whole.counts.items():
                self.channel_stats[channel] += count
        written = self._written
        self.message_start_time = min((each.start for each in written), default=NO_MESSAGE_YET)
        self.message_end_time = max((each.end for each in written), default=0)

    def _cut_back(self) -> None:
        os.truncate(self.path, self._end)
        whole = self.path.open('ab')
        if not self.bio.closed:
            # The refused bytes are still in the old buffer, which closing would write again.
            with Path(os.devnull).open('wb') as nowhere:
                os.dup2(nowhere.fileno(), self.bio.fileno())
            self.bio.close()
        self.bio = whole
