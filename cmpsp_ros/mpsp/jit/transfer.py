"""All kept machine code in one file, for computers that are equal to this one."""

import hashlib
import io
import json
import re
import tarfile
from pathlib import Path
from typing import Final

from cmpsp_ros.mpsp.jit import internals
from cmpsp_ros.mpsp.jit.cache import is_whole, kernel_folder, save_whole
from cmpsp_ros.mpsp.jit.fingerprint import VERSIONS

_ABOUT: Final = 'about.json'
_KERNEL: Final = re.compile(r'[\w.-]+\.[0-9a-f]{32}\.kernel')
_PACKAGE: Final = Path(__file__).parents[2]


class TransferError(ValueError):
    """A file of kernels that cannot be written, or used here."""


def export_kernels(path: Path) -> int:
    """Write all kept kernels to a file; returns their number.

    Raises:
        TransferError: The file cannot be written, or there is no folder of kernels.
    """
    folder = _folder()
    kernels = sorted(folder.glob('*.kernel'))
    try:
        with tarfile.open(path, 'w') as archive:
            about = json.dumps(_about(), indent=1).encode()
            info = tarfile.TarInfo(_ABOUT)
            info.size = len(about)
            archive.addfile(info, io.BytesIO(about))
            for each in kernels:
                archive.add(each, each.name)
    except OSError as error:
        raise TransferError(f'{path}: {error.strerror or error}') from error
    return len(kernels)


def import_kernels(path: Path) -> int:
    """Keep the kernels of a file, which is trusted as a program is; returns their number.

    Raises:
        TransferError: It was written by another computer, version or code, or it is damaged.
    """
    folder = _folder()
    try:
        with tarfile.open(path) as archive:
            first, *members = archive.getmembers()
            contents = [_read(archive, each) for each in (first, *members)]
        found = json.loads(contents[0])
        if first.name != _ABOUT or not isinstance(found, dict):
            raise TransferError(f'{path}: found no {_ABOUT}, wanted a file of `warmup --export`')
    except OSError as error:
        raise TransferError(f'{path}: {error.strerror or error}') from error
    except (tarfile.TarError, ValueError) as error:
        raise TransferError(f'{path}: found {error}, wanted a file of `warmup --export`') from error
    for name, wanted in _about().items():
        if found.get(name) != wanted:
            raise TransferError(f'{path}: {name}: found {found.get(name)}, wanted {wanted}')
    kernels = [*zip(members, contents[1:], strict=True)]
    for member, content in kernels:
        if not _KERNEL.fullmatch(member.name) or not is_whole(content):
            raise TransferError(
                f'{path}: {member.name}: found a damaged kernel, wanted a whole one'
            )
    try:
        for member, content in kernels:
            save_whole(folder / member.name, content)
    except OSError as error:
        raise TransferError(f'{folder}: {error.strerror or error}') from error
    return len(kernels)


def _folder() -> Path:
    if (folder := kernel_folder()) is None:
        raise TransferError('found no folder for kernels, wanted one (NUMBA_CACHE_DIR)')
    return folder


def _read(archive: tarfile.TarFile, member: tarfile.TarInfo) -> bytes:
    file = archive.extractfile(member) if member.isreg() else None
    if file is None:
        raise ValueError(f'{member.name!r}, which is no plain file')
    return file.read()


def _about() -> dict[str, str]:
    """All that machine code depends on, by name."""
    digest = hashlib.sha256()
    for each in sorted(_PACKAGE.rglob('*.py')):
        digest.update(each.relative_to(_PACKAGE).as_posix().encode() + b'\0' + each.read_bytes())
    system, processor, features, *options = map(str, internals.this_target())
    return {
        'versions': VERSIONS,
        'system': system,
        'processor': processor,
        'features of the processor': features,
        'options of the compiler': ' '.join(options),
        'code of cmpsp_ros': digest.hexdigest()[:16],
    }
