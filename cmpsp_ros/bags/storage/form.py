"""How a bag is written."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

StorageName = Literal['mcap', 'sqlite3']

NO_MESSAGE_YET = 2**63 - 1
"""What rosbag2 writes as the beginning of a bag without messages [ns]."""


@dataclass(frozen=True)
class Form:
    """Format of a bag.

    Attributes:
        storage: Format of its files.
        compressed: Whether chunks are compressed by zstd; mcap only.
        split_size: Size at which a new file is begun [bytes]; 0 for a single file.
        split_duration: Duration after which a new file is begun [ns]; 0 for a single file.
    """

    storage: StorageName = 'mcap'
    compressed: bool = False
    split_size: int = 0
    split_duration: int = 0
