"""How much memory a process has in use."""

from __future__ import annotations

from pathlib import Path

from benchmarks.errors import BenchError


def resident(pid: int | str = 'self') -> float:
    """Resident set of a process [MB], as Linux counts it.

    Args:
        pid: Of the process; this one when absent.

    Raises:
        BenchError: There is no such process, or the system does not tell.
    """
    path = Path(f'/proc/{pid}/status')
    try:
        lines = path.read_text(encoding='utf-8').splitlines()
    except OSError as error:
        raise BenchError(f'{path}: {error.strerror or error}') from error
    for line in lines:
        name, _, value = line.partition(':')
        if name == 'VmRSS':
            return float(value.split()[0]) * 1024 / 1e6
    raise BenchError(f'{path}: found no VmRSS, wanted a process that is alive')
