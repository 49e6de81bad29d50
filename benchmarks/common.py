"""Shared by all benchmarks: error, quiet, machine, spread of a sample, table."""

from __future__ import annotations

import gc
import io
import os
import platform
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from typing import Literal, TypeVar

import numpy as np
import psutil
from numpy.typing import ArrayLike
from rich.markup import escape
from rich.table import Table as RichTable

from cmpsp_ros.studies import cpu_model

_Key = TypeVar('_Key')
_Result = TypeVar('_Result')


class BenchError(RuntimeError):
    """A benchmark cannot be run as requested; the message names finding and requirement."""


@contextmanager
def collector_off() -> Iterator[None]:
    """Disable the garbage collector, as the guidance node does, after a full collection.

    Objects that exist by then are not examined again, so that a nested collection is quick.
    """
    was_on = gc.isenabled()
    gc.collect()
    if was_on:
        gc.freeze()
        gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.unfreeze()
            gc.enable()


def in_turn(
    tasks: Mapping[_Key, Callable[[], _Result]], runs: int, progress: Callable[[], None]
) -> dict[_Key, list[_Result]]:
    """Results of tasks repeated in turn, so that other load of the machine affects all."""
    results: dict[_Key, list[_Result]] = {key: [] for key in tasks}
    for _ in range(runs):
        for key, task in tasks.items():
            results[key].append(task())
            progress()
    return results


def timed(call: Callable[..., object], *args: object) -> float:
    """Time of one call [us]."""
    began = time.perf_counter_ns()
    call(*args)
    return (time.perf_counter_ns() - began) * 1e-3


@contextmanager
def unheard() -> Iterator[None]:
    """Suppress the output of a solver: one that fails may print its whole problem."""
    with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
        yield


_PACKAGES = ('numpy', 'numba', 'daqp', 'qpsolvers', 'casadi', 'rclpy')


def machine() -> dict[str, str]:
    """Processor, kernel, Python and the packages that matter, each as text."""
    found = {
        'processor': cpu_model(),
        'cores': str(os.cpu_count()),
        'load before': f'{os.getloadavg()[0]:.2f}',
        'kernel': f'{platform.system()} {platform.release()}',
        'Python': platform.python_version(),
    }
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = 'not installed'
    return found


def resident(pid: int | None = None) -> float:
    """Resident set of a process [MB]; of this one without a number."""
    return float(_process(pid).memory_info().rss) / 1e6


def processor_time(pid: int) -> float:
    """Processor time that a process has had [s]."""
    spent = _process(pid).cpu_times()
    return float(spent.user + spent.system)


def _process(pid: int | None) -> psutil.Process:
    try:
        return psutil.Process(pid)
    except psutil.NoSuchProcess as error:
        raise BenchError(f'process {pid}: {error.msg}') from error


@dataclass(frozen=True)
class Spread:
    """Statistics of a sample, in its own unit."""

    count: int  # size
    median: float
    p99: float | None  # 99th percentile; None below 100 values, where it would be the maximum
    p999: float | None  # 99.9th percentile; None below 1000 values
    largest: float  # maximum

    @classmethod
    def of(cls, values: ArrayLike) -> Spread:
        """Statistics of at least one value, in any shape."""
        sample = np.asarray(values, float).ravel()
        return cls(
            sample.size,
            float(np.median(sample)),
            float(np.percentile(sample, 99.0)) if sample.size >= 100 else None,
            float(np.percentile(sample, 99.9)) if sample.size >= 1000 else None,
            float(sample.max()),
        )


@dataclass(frozen=True)
class Table:
    """A part of the results."""

    title: str  # heading
    columns: Sequence[str]  # names of the columns
    rows: Sequence[Sequence[str]]  # cells as text
    note: str = ''  # note to the reader
    words: int = 1  # number of leading columns that hold words and not numbers

    def markdown(self) -> str:
        """With its title as a heading and its note before it."""
        lines = [
            self.columns,
            ['---' if place < self.words else '---:' for place in range(len(self.columns))],
            *self.rows,
        ]
        body = '\n'.join('| ' + ' | '.join(line) + ' |' for line in lines)
        return '\n\n'.join(part for part in (f'## {self.title}', self.note, body) if part)

    def rich(self) -> RichTable:
        """For the terminal, without the note."""
        # Units stand in brackets, which is how rich marks its styles.
        table = RichTable(title=escape(self.title))
        for place, column in enumerate(self.columns):
            side: Literal['left', 'right'] = 'left' if place < self.words else 'right'
            table.add_column(escape(column), justify=side, overflow='fold')
        for row in self.rows:
            table.add_row(*map(escape, row))
        return table
