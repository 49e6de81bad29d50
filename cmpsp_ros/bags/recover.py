"""A valid bag from the files of a killed process or after a loss of power."""

import json
import shutil
from dataclasses import dataclass
from pathlib import Path

from rosbags.rosbag2 import ReaderError

from cmpsp_ros.bags.custom_data import PARAMETERS_KEY, SOFTWARE_KEY, parsed
from cmpsp_ros.bags.errors import BagError, UnknownTypeError
from cmpsp_ros.bags.storage import common
from cmpsp_ros.bags.storage.checks import read_metadata, salvage
from cmpsp_ros.bags.storage.limits import MAX_METADATA, check_file
from cmpsp_ros.bags.writer import BagWriter


@dataclass(frozen=True)
class Recovery:
    """The new bag, its numbers of messages and topics, and omissions with reasons."""

    path: Path
    messages: int
    topics: int
    remarks: tuple[str, ...]


def recover(path: Path, output: Path | None = None) -> Recovery:
    """Write a valid bag from the readable parts of a folder or file, which is not changed.

    Its folder is by default beside the other, its name with `_recovered`. Raises BagError if
    nothing can be read.
    """
    files = _storage_files(path)
    beside = path.resolve()
    name = beside.stem if path.is_file() else beside.name
    target = output or beside.with_name(f'{name}_recovered')
    remarks: list[str] = []
    topics: set[str] = set()
    bag = BagWriter(target, common.Form(common.SUFFIXES[files[0].suffix]))
    try:
        with bag:
            bag.set_custom(_custom_data(path, remarks))
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
    """Storage files of a bag in order of time: they are numbered without leading zeros."""
    if not path.exists():
        raise BagError(f'{path}: no such bag')
    if path.is_dir() and common.is_locked(path):
        raise BagError(f'{path}: being written right now; stop the recorder first')

    def place(file: Path) -> tuple[int, str]:
        number = file.stem.rpartition('_')[2]
        return (int(number) if number.isdecimal() and len(number) < 10 else 0), file.name

    files = [path] if path.is_file() else [*path.iterdir()]
    for suffix in common.SUFFIXES:
        if found := [each for each in files if each.suffix == suffix]:
            return sorted(found, key=place)
    raise BagError(f'{path}: not a bag: expected files that end in {" or ".join(common.SUFFIXES)}')


def _copy(file: Path, bag: BagWriter, topics: set[str], remarks: list[str]) -> None:
    left_out: set[str] = set()
    for found in salvage(file, bag.path.parent, remarks.append):
        topic = found if isinstance(found, common.FoundTopic) else found[0]
        if topic.name not in topics and topic.name not in left_out:
            try:
                bag.topic(topic.name, topic.msgtype, topic.qos_profiles, topic.definition)
                topics.add(topic.name)
            except UnknownTypeError as error:
                left_out.add(topic.name)
                remarks.append(str(error))
        if not isinstance(found, common.FoundTopic) and topic.name in topics:
            bag.write(topic.name, found[1], found[2])


def _custom_data(path: Path, remarks: list[str]) -> dict[str, str]:
    """Texts kept with the bag when it was closed, or else while it was written."""
    folder = path if path.is_dir() else path.parent
    for name in (common.METADATA, common.UNFINISHED):
        if not (folder / name).exists():
            continue
        try:
            if name == common.METADATA:
                found = read_metadata(folder).get('custom_data')
            else:
                check_file(folder / name, MAX_METADATA)
                found = json.loads((folder / name).read_text(encoding='utf-8'))
            items = found.items() if isinstance(found, dict) else ()
            texts = {key: value for key, value in items if {type(key), type(value)} == {str}}
            for key in (PARAMETERS_KEY, SOFTWARE_KEY):
                parsed(texts, key)
        except (ReaderError, OSError, ValueError, TypeError, RecursionError) as error:
            remarks.append(f'{name}: left out: {" ".join(str(error).split())}')
        else:
            return texts
    return {}
