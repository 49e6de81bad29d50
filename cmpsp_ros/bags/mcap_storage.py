"""Mcap storage that takes back what the disk refused."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING

from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.storage_mcap import McapWriter

if TYPE_CHECKING:
    from collections.abc import Mapping

    from rosbags.rosbag2.enums import CompressionMode
    from rosbags.rosbag2.writer import StorageWriter

TOPIC_METADATA_SIZE = 1536
"""What a topic takes in the metadata, with a few publishers [bytes]."""


class RevocableMcap(McapWriter):
    """A file that ends in a whole chunk whenever no call is under way.

    When the disk refuses a chunk, or the index at the end, the file is cut back to its last whole
    chunk and the refused messages stay in memory: the same call can be made again.
    """

    def __init__(self, path: Path, compression: CompressionMode) -> None:
        super().__init__(path, compression)
        self.bio.flush()
        self._whole = self.bio.tell()
        self._written: list[tuple[int, dict[int, int]]] = []

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
        self._written.append((self._whole, counts))
        self._whole = self.bio.tell()

    def close(self, version: int, metadata: str) -> None:
        """Write pending chunk, metadata and index, and close the file.

        Raises:
            OSError: The disk refuses; the file ends in its last whole chunk.

        """
        try:
            super().close(version, metadata)
        except OSError:
            self._cut_back()
            raise

    def make_room(self, metadata_size: int) -> None:
        """Forget the pending chunk, and chunks from the end until index and metadata fit.

        Args:
            metadata_size: Room the metadata takes, in this file and once more beside it [bytes].

        """
        counts = {channel: len(messages) for channel, messages in self.chunk.msgs.items()}
        self._discount(counts)
        self.chunk.msgs.clear()
        self.chunk.bio.seek(0)
        self.chunk.bio.truncate()
        end = self._whole
        texts = sum(len(each.data.encode()) for each in self.schemas)
        # The definitions and the channels' metadata are repeated in the index.
        wanted = 3 * metadata_size + texts + sum(each.tell() for each in self.chunks)
        while self._written and end - self._whole < wanted:
            self._whole, counts = self._written.pop()
            self.chunks.pop()
            self._discount(counts)
        self._cut_back()

    def _discount(self, counts: Mapping[int, int]) -> None:
        for channel, count in counts.items():
            self.channel_stats[channel] -= count

    def _cut_back(self) -> None:
        os.truncate(self.path, self._whole)
        whole = self.path.open('ab')
        if not self.bio.closed:
            # The refused bytes are still in the old buffer, which closing would write again.
            with Path(os.devnull).open('wb') as nowhere:
                os.dup2(nowhere.fileno(), self.bio.fileno())
            self.bio.close()
        self.bio = whole


class RevocableWriter(Writer):
    """rosbags' writer on `RevocableMcap`."""

    STORAGE_PLUGINS: Mapping[StoragePlugin, type[StorageWriter]] = {
        **Writer.STORAGE_PLUGINS,
        StoragePlugin.MCAP: RevocableMcap,
    }

    def flush(self) -> None:
        """Hand everything written so far to the operating system.

        Raises:
            OSError: The disk refuses.

        """
        if isinstance(self.storage, RevocableMcap) and self.storage.chunk.msgs:
            self.storage.close_chunk()

    def make_room(self) -> int:
        """Give up what the disk refused, and what else must go for index and metadata to fit.

        Returns:
            Number of messages given up.

        Raises:
            OSError: The file is closed already, only the metadata beside it is missing.

        """
        if not isinstance(self.storage, RevocableMcap):
            msg = 'no room for the metadata'
            raise OSError(msg)
        before = sum(self.storage.channel_stats.values())
        texts = sum(len(each) for each in self.custom_data.values())
        self.storage.make_room(TOPIC_METADATA_SIZE * (len(self.connections) + 1) + texts)
        self.counts = dict(self.storage.channel_stats)
        return before - sum(self.counts.values())
