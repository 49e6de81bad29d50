"""A valid bag from the files of a killed process or after a loss of power."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from pathlib import Path

from rosbags.rosbag2 import ReaderError

from cmpsp_ros.bags.custom_data import PARAMETERS_KEY, RESTARTS_KEY, SOFTWARE_KEY, parsed
from cmpsp_ros.bags.errors import BagError, UnknownTypeError
from cmpsp_ros.bags.storage.checks import read_metadata
from cmpsp_ros.bags.storage.folder import METADATA, UNFINISHED, is_locked
from cmpsp_ros.bags.storage.form import Form
from cmpsp_ros.bags.storage.limits import MAX_METADATA, check_file
from cmpsp_ros.bags.storage.salvage import FoundTopic, salvage
from cmpsp_ros.bags.writer import BagWriter

_SUFFIXES = ('.mcap', '.db3')


@dataclass(frozen=True)
class Recovery:
    """Result of a recovery.

    Attributes:
        path: The new bag.
        messages: Number of messages in it.
        topics: Number of topics in it.
        remarks: What was left out, and why.
    """

    path: Path
    messages: int
    topics: int
    remarks: tuple[str, ...]


def recover(path: Path, output: Path | None = None) -> Recovery:
    """Write a valid bag from the readable parts of another, which is not changed.

    Args:
        path: Folder of the bag, with or without its metadata, or one storage file.
        output: Folder of the new bag; when absent, beside the other, its name with `_recovered`.

    Raises:
        BagError: Not a bag, being written, nothing in it can be read, or the disk refuses.
    """
    files = _storage_files(path)
    beside = path.resolve()
    name = beside.stem if path.is_file() else beside.name
    target = output or beside.with_name(f'{name}_recovered')
    remarks: list[str] = []
    topics: dict[str, FoundTopic] = {}
    form = Form('mcap' if files[0].suffix == '.mcap' else 'sqlite3')
    bag = BagWriter(target, form)
    try:
        with bag:
            bag.set_custom(_custom(path, remarks))
            for file in files:
                _copy(file, bag, topics, remarks)
    except OSError as error:
        raise BagError(f'{path}: cannot be read: {error}') from error
    if not topics:
        shutil.rmtree(target)
        msg = f'{path}: no topic can be recovered: {"; ".join(remarks) or "there is none"}'
        raise BagError(msg)
    return Recovery(target, bag.message_count, len(topics), tuple(remarks))


def _storage_files(path: Path) -> list[Path]:
    """The storage files of a bag, in order of time."""
    if not path.exists():
        raise BagError(f'{path}: no such bag')
    if path.is_dir() and is_locked(path):
        raise BagError(f'{path}: being written right now; stop the recorder first')
    files = [path] if path.is_file() else [*path.iterdir()]
    for suffix in _SUFFIXES:
        if found := [each for each in files if each.suffix == suffix]:
            return sorted(found, key=_place)
    raise BagError(f'{path}: not a bag: expected files that end in {" or ".join(_SUFFIXES)}')


def _place(path: Path) -> tuple[int, str]:
    """Place of a storage file: they are numbered without leading zeros."""
    number = path.stem.rpartition('_')[2]
    return (int(number) if number.isdecimal() and len(number) < 10 else 0), path.name


def _copy(file: Path, bag: BagWriter, topics: dict[str, FoundTopic], remarks: list[str]) -> None:
    left_out: set[str] = set()
    for found in salvage(file, bag.path.parent, remarks.append):
        topic = found if isinstance(found, FoundTopic) else found[0]
        if topic.name not in topics and topic.name not in left_out:
            try:
                bag.topic(topic.name, topic.msgtype, topic.qos_profiles, topic.definition)
                topics[topic.name] = topic
            except UnknownTypeError as error:
                left_out.add(topic.name)
                remarks.append(str(error))
        if not isinstance(found, FoundTopic) and topic.name in topics:
            bag.write(topic.name, found[1], found[2])


def _custom(path: Path, remarks: list[str]) -> dict[str, str]:
    """What was kept with the bag: when it was closed, or else while it was written."""
    folder = path if path.is_dir() else path.parent
    for name, read in ((METADATA, _closed), (UNFINISHED, _unfinished)):
        if (folder / name).exists():
            try:
                return _sound(read(folder))
            except (ReaderError, OSError, ValueError, TypeError, RecursionError) as error:
                remarks.append(f'{name}: left out: {" ".join(str(error).split())}')
    return {}


def _closed(folder: Path) -> object:
    return read_metadata(folder).get('custom_data')


def _unfinished(folder: Path) -> object:
    check_file(folder / UNFINISHED, MAX_METADATA)
    return json.loads((folder / UNFINISHED).read_text(encoding='utf-8'))


def _sound(found: object) -> dict[str, str]:
    """The texts among what was kept, when those that are read again can be."""
    items = found.items() if isinstance(found, dict) else ()
    texts = {key: value for key, value in items if isinstance(key, str) and isinstance(value, str)}
    for key in (PARAMETERS_KEY, RESTARTS_KEY, SOFTWARE_KEY):
        parsed(texts, key)
    return texts
