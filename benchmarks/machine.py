"""What the times were taken on, and how much memory and processor time a process has had."""

from __future__ import annotations

import os
import platform
from importlib.metadata import PackageNotFoundError, version

import psutil

from benchmarks.errors import BenchError
from cmpsp_ros.studies import cpu_model

_PACKAGES = ('numpy', 'numba', 'daqp', 'qpsolvers', 'casadi', 'acados_template', 'rclpy')


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
