"""How much memory and processor time a process has had."""

from __future__ import annotations

import psutil

from benchmarks.errors import BenchError


def resident(pid: int | None = None) -> float:
    """Resident set of a process [MB]; of this one without a number.

    Raises:
        BenchError: There is no such process.
    """
    return float(_process(pid).memory_info().rss) / 1e6


def processor_time(pid: int) -> float:
    """Processor time that a process has had [s].

    Raises:
        BenchError: There is no such process.
    """
    spent = _process(pid).cpu_times()
    return float(spent.user + spent.system)


def _process(pid: int | None) -> psutil.Process:
    try:
        return psutil.Process(pid)
    except psutil.NoSuchProcess as error:
        raise BenchError(f'process {pid}: {error.msg}') from error
