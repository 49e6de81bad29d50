"""Checks of untrusted bags, before rosbags reads them.

rosbags trusts the sizes in a file: it decompresses, parses and allocates accordingly. Every such
size is bounded here first, so its reader can be used unchanged.
"""

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import yaml
from rosbags.rosbag2 import Reader, ReaderError

from cmpsp_ros.bags.storage import limits
from cmpsp_ros.bags.storage.common import INFORMATION, METADATA, SUFFIXES, Found, Remark
from cmpsp_ros.bags.storage.mcap import check_mcap, salvage_mcap
from cmpsp_ros.bags.storage.sqlite import check_sqlite, salvage_sqlite

_CHECKS = {'mcap': check_mcap, 'sqlite3': check_sqlite}


def read_metadata(folder: Path) -> dict[str, Any]:
    """Metadata of a bag's folder."""
    path = folder / METADATA
    limits.check_file(path, limits.MAX_METADATA)
    text = path.read_text(encoding='utf-8')
    limits.check_yaml(text)
    try:
        document = yaml.load(text, Loader=yaml.CSafeLoader)
    except (yaml.YAMLError, ValueError, LookupError, TypeError, AttributeError) as error:
        raise ReaderError(f'{METADATA} is damaged: {" ".join(str(error).split())}') from error
    information = document.get(INFORMATION) if isinstance(document, dict) else None
    if not isinstance(information, dict):
        raise ReaderError(f'{METADATA} has no {INFORMATION}')
    return information


def check_bag(path: Path) -> dict[str, Any]:
    """Check that rosbags can read a bag in bounded memory and time; returns a folder's metadata."""
    if not path.is_dir():
        _check_storage(path, SUFFIXES.get(path.suffix, ''))
        return {}
    information = read_metadata(path)
    storage = str(information.get('storage_identifier'))
    compression = str(information.get('compression_mode')).lower()
    for file in _files(path, information):
        if compression != 'file':
            _check_storage(file, storage)
        else:
            with TemporaryDirectory() as folder:
                _check_storage(limits.inflate_file(file, Path(folder, file.stem)), storage)
        if compression == 'message':
            with Reader(file) as reader:
                for _, _, raw in reader.messages():
                    limits.inflate(raw, 'zstd', limits.MAX_CHUNK)
    topics = information.get('topics_with_message_count')
    if isinstance(topics, list) and len(topics) > limits.MAX_TOPICS:
        raise ReaderError(f'{len(topics)} topics, at most {limits.MAX_TOPICS} are read')
    return information


def salvage(path: Path, folder: Path, remark: Remark) -> Iterator[Found]:
    """Iterate over the readable remains of a file, each topic before its messages.

    Temporary files go to `folder`; `remark` is called with each reason for an omission.
    """
    try:
        limits.check_file(path)
    except ReaderError as error:
        remark(str(error))
        return
    read = salvage_mcap if path.suffix == '.mcap' else salvage_sqlite
    yield from read(path, folder, remark)


def _files(folder: Path, information: dict[str, Any]) -> list[Path]:
    paths = information.get('relative_file_paths')
    if not isinstance(paths, list) or not 0 < len(paths) <= limits.MAX_FILES:
        raise ReaderError(f'{METADATA} names no files, or more than {limits.MAX_FILES}')
    names = [str(each).rpartition('/')[2] for each in paths]
    if len(set(names)) < len(names):
        raise ReaderError(f'{METADATA} names a file twice')
    for name in names:
        if not (folder / name).exists():
            raise ReaderError(f'{METADATA} names {name}, which is not there')
    return [folder / name for name in names]


def _check_storage(path: Path, storage: str) -> None:
    limits.check_file(path)
    if storage not in _CHECKS:
        raise ReaderError(f'storage {storage!r}, wanted one of {", ".join(_CHECKS)}')
    _CHECKS[storage](path)
