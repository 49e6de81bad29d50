"""The folder of a run, and the error of this package."""

from __future__ import annotations

import shutil
from datetime import datetime
from pathlib import Path


class DemoError(RuntimeError):
    """A run could not be started or did not end; the message says why."""


_RUNS = Path('runs')
_CONTENT = (
    'bag',
    'parameters.yaml',
    'summary.json',
    'trajectory.png',
    'wheel_speeds.png',
    'recorder.log',
    'sim_node.log',
    'guidance_node.log',
    'viewer.log',
)


def make_folder(output: Path | None, *, force: bool) -> Path:
    """Create the folder of a run.

    Args:
        output: The folder; None for `runs/<time>`, which `runs/latest` then points at.
        force: True if an earlier run in that folder may be removed; other files there stay.
    """
    folder = output or _RUNS / datetime.now().astimezone().strftime('%Y-%m-%d_%H-%M-%S')
    try:
        if folder.exists():
            if not force:
                raise DemoError(
                    f'{folder}: found an existing folder, wanted a new one; --force replaces the'
                    ' run in it'
                )
            _clear(folder)
        folder.mkdir(parents=True, exist_ok=True)
        if output is None:
            latest = _RUNS / 'latest'
            latest.unlink(missing_ok=True)
            latest.symlink_to(folder.name)
    except OSError as error:
        raise DemoError(f'{folder}: {error.strerror or error}') from error
    return folder


def _clear(folder: Path) -> None:
    robots = [each.parent.name for each in folder.glob('*/guidance_node.log')]
    for name in (*_CONTENT, *robots):
        path = folder / name
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)
