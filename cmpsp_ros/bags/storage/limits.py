"""Limits for bags: every size is bounded before anything is allocated for it."""

import stat
import sys

import yaml
from lz4.frame import LZ4FrameDecompressor  # type: ignore[import-untyped]
from rosbags.rosbag2 import ReaderError

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

from pathlib import Path

_MEGABYTE = 1 << 20

# Size of a `metadata.yaml`, and of all QoS profiles in a storage file [bytes].
MAX_METADATA = 2 * _MEGABYTE
MAX_DEPTH = 20  # nesting of YAML; what rosbag2 writes is 7 deep
MAX_FILES = 10_000  # storage files of one bag
MAX_TOPICS = 2_000  # topics of one bag

# Index at the end of an mcap file [bytes]; a day at one chunk a second takes 20 MB.
MAX_SUMMARY = 64 * _MEGABYTE
MAX_CHUNKS = 200_000  # chunks of an mcap file; a day at one chunk a second has 86,400
MAX_CHUNK = 64 * _MEGABYTE  # chunk of an mcap file, uncompressed, and any single message [bytes]
MAX_HELD = 192 * _MEGABYTE  # messages held to bring chunks that overlap in time into order [bytes]

# Storage file that is compressed as a whole, uncompressed [bytes].
MAX_INFLATED_FILE = 2048 * _MEGABYTE
MAX_SEQUENCE = 1_000_000  # elements of one sequence in a message

# zstd reduces messages to a tenth or a fiftieth, zeros to a twenty-thousandth.
_MAX_RATIO = 100
_FREE_RATIO = 256 * _MEGABYTE

_WINDOW_LOG = 26


def check_file(path: Path, limit: int | None = None) -> None:
    """Check that a path is a regular file, no larger than a limit [bytes]; pipes are waited for."""
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):
        raise ReaderError(f'{path.name} is not a regular file')
    if limit is not None and status.st_size > limit:
        raise ReaderError(f'{path.name} has {status.st_size} bytes, at most {limit} are read')


def check_yaml(text: str) -> None:
    """Check that parsing YAML does not multiply its size: aliases do, and nesting."""
    depth = 0
    try:
        for event in yaml.parse(text, Loader=yaml.CSafeLoader):
            if isinstance(event, yaml.AliasEvent):
                raise ReaderError(f'YAML with an alias {event.anchor!r}, which no bag needs')
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            if depth > MAX_DEPTH:
                raise ReaderError(f'YAML nested more than {MAX_DEPTH} deep')
    except yaml.YAMLError as error:
        raise ReaderError(f'not YAML: {" ".join(str(error).split())}') from error


def inflate(data: bytes, compression: str, limit: int, *, truncated: bool = False) -> bytes:
    """Uncompress one frame, or the beginning of a truncated one, to at most `limit` bytes."""
    inflated, complete = data, True
    if compression:
        if compression == 'zstd':
            options = {int(zstd.DecompressionParameter.window_log_max): _WINDOW_LOG}
            inflater = zstd.ZstdDecompressor(options=options)
        elif compression == 'lz4':
            inflater = LZ4FrameDecompressor()
        else:
            raise ReaderError(f'unknown compression {compression!r}')
        try:
            inflated = inflater.decompress(data, max_length=limit + 1)
        except (zstd.ZstdError, RuntimeError) as error:
            raise ReaderError(f'damaged {compression} data: {error}') from error
        complete = inflater.eof and not inflater.unused_data
    if len(inflated) > limit:
        raise ReaderError(f'more than {limit} bytes uncompressed')
    if not (complete or truncated):
        raise ReaderError(f'{compression} data cut off')
    return inflated


def inflated_allowed(size: int) -> int:
    """Maximum total size of the uncompressed chunks of a file of a size [bytes]."""
    return _FREE_RATIO + _MAX_RATIO * size


def inflate_file(source: Path, target: Path) -> Path:
    """Uncompress a file that is compressed by zstd as a whole; returns the target."""
    check_file(source)
    size = 0
    with zstd.open(source, 'rb') as file, target.open('wb') as output:
        while piece := file.read(_MEGABYTE):
            size += output.write(piece)
            if size > MAX_INFLATED_FILE:
                msg = f'{source.name} has more than {MAX_INFLATED_FILE} bytes uncompressed'
                raise ReaderError(msg)
    return target
