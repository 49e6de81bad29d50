"""Common to both storages: the format of a bag, its folder and lock, recovered topics."""

import fcntl
import os
import sqlite3
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat, Qos
from rosbags.rosbag2 import ReaderError
from rosbags.rosbag2.metadata import parse_qos

from cmpsp_ros.bags.storage.limits import check_yaml

Remark = Callable[[str], None]

StorageName = Literal['mcap', 'sqlite3']

REFUSALS = OSError, sqlite3.Error  # errors of a storage when the disk refuses

# Storage by the suffix of its files.
SUFFIXES: dict[str, StorageName] = {'.mcap': 'mcap', '.db3': 'sqlite3'}
METADATA = 'metadata.yaml'  # description of a complete bag
INFORMATION = 'rosbag2_bagfile_information'  # key of all in it
UNFINISHED = 'unfinished.json'  # custom data of a bag that is being written
NO_MESSAGE_YET = 2**63 - 1  # start time that rosbag2 writes for a bag without messages [ns]
_FORMATS = {'ros2msg': MessageDefinitionFormat.MSG, 'ros2idl': MessageDefinitionFormat.IDL}


@dataclass(frozen=True)
class Form:
    """Format of a bag, and when a new file is begun; never where both are 0."""

    storage: StorageName = 'mcap'
    compressed: bool = False  # chunks of mcap only, by zstd
    split_size: int = 0  # [bytes]
    split_duration: int = 0  # [ns]


@dataclass(frozen=True)
class FoundTopic:
    """A topic as described by its storage file; without definition if the file has none."""

    name: str
    msgtype: str
    definition: MessageDefinition | None
    qos_profiles: tuple[Qos, ...]


# A topic, or a message of it with its stamp [ns].
Found = tuple[FoundTopic, int, bytes] | FoundTopic


def read_definition(encoding: str, text: str) -> MessageDefinition | None:
    """Definition of a type from its text in a storage file."""
    kind = _FORMATS.get(encoding)
    return MessageDefinition(kind, text) if kind and text else None


def read_profiles(text: str) -> tuple[Qos, ...]:
    """QoS profiles, empty if damaged: that is no reason to lose the messages."""
    try:
        check_yaml(text)
        return tuple(parse_qos(text))
    except (ReaderError, ValueError, LookupError, TypeError, AttributeError):
        return ()


def locked(folder: Path) -> int:
    """File descriptor of a folder with the writer's lock, which ends with it or the process."""
    file = os.open(folder, os.O_RDONLY)
    # Some network file systems have no locks, and the bag is good all the same.
    with suppress(OSError):
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    return file


def is_locked(folder: Path) -> bool:
    """True while a writer holds the lock of a folder."""
    file = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        return False
    finally:
        os.close(file)
    return False


def write_atomically(path: Path, text: str) -> None:
    """Write a file that is either complete or not there."""
    draft = path.with_name(f'{path.name}.tmp')
    with draft.open('w', encoding='utf-8') as file:
        file.write(text)
        file.flush()
        os.fsync(file.fileno())
    draft.replace(path)
