"""Shared by studies and benchmarks: their error, the style of pictures, the processor's name."""

import platform
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import matplotlib as mpl

WIDTH: Final = 7.2  # width of a picture across both columns of a page [in]

# Of type Any: matplotlib lists every key of its settings as a literal of its own.
_STYLE: Final[Any] = {
    'font.family': 'sans-serif',
    'font.sans-serif': ['DejaVu Sans'],
    'font.size': 8.0,
    'axes.titlesize': 8.0,
    'axes.labelsize': 8.0,
    'xtick.labelsize': 7.0,
    'ytick.labelsize': 7.0,
    'legend.fontsize': 7.0,
    'legend.frameon': False,
    'axes.linewidth': 0.6,
    'lines.linewidth': 1.1,
    'xtick.direction': 'in',
    'ytick.direction': 'in',
    'grid.linewidth': 0.4,
    'grid.color': '0.85',
    # Text stays text, and the names of clip paths do not change from one run to the next.
    'svg.fonttype': 'none',
    'svg.hashsalt': 'cmpsp',
}


class StudyError(ValueError):
    """A study cannot be run as requested; the message names finding and expectation."""


class UsageError(StudyError):
    """A study was asked for in a way that cannot be."""


@contextmanager
def disk_errors(path: Path) -> Iterator[None]:
    """Turn a refusal of the disk into a `StudyError`."""
    try:
        yield
    except OSError as error:
        raise StudyError(f'{path}: {error.strerror or error}') from error


@contextmanager
def plot_style() -> Iterator[None]:
    """Draw and save in the style of a journal, independent of the user's matplotlib settings."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_STYLE)
        yield


def cpu_model() -> str:
    """Name of the processor."""
    try:
        lines = Path('/proc/cpuinfo').read_text(encoding='utf-8').splitlines()
    except OSError:
        lines = []
    names = [line.partition(':')[2].strip() for line in lines if line.startswith('model name')]
    return names[0] if names else platform.processor() or platform.machine()
