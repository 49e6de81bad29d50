"""What the times were taken on."""

from __future__ import annotations

import os
import platform
from importlib.metadata import PackageNotFoundError, version

from cmpsp_ros.studies.processor import cpu_model

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
