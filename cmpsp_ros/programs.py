"""Entry points of the installed programs; a missing package is named with what installs it."""

from __future__ import annotations

import sys
from functools import partial
from importlib import import_module
from typing import Final

_ROS: Final = ('rclpy', 'rmw_', 'rcl_interfaces', 'std_', 'geometry_msgs', 'nav_msgs')
_PIP: Final = {
    'PIL': 'pillow',
    'backports': 'backports.zstd',
    'lz4': 'lz4',
    'matplotlib': 'matplotlib',
    'numba': 'numba',
    'numpy': 'numpy',
    'rich': 'rich',
    'rosbags': 'rosbags',
    'scipy': 'scipy',
    'typer': 'typer',
    'yaml': 'pyyaml',
}
"""Package by the module that is imported."""


def _run(module: str) -> None:
    """Run `main` of a module.

    Raises:
        SystemExit: A package is not installed: a sentence that says which, and how to install it.
    """
    try:
        import_module(module).main()
    except ModuleNotFoundError as error:
        name = (error.name or '').partition('.')[0]
        if name.startswith(_ROS):
            sys.exit(f'found no {name}: source a ROS 2, or `pip install cmpsp_ros[ros]`')
        if name not in _PIP:
            raise
        sys.exit(
            f'found no Python module {name}: `{sys.executable} -m pip install {_PIP[name]}`;'
            ' on a robot in a virtual environment: doc/user/install.md'
        )


cmpsp = partial(_run, 'cmpsp_ros.cli')
guidance_node = partial(_run, 'cmpsp_ros.nodes.guidance.node')
sim_node = partial(_run, 'cmpsp_ros.nodes.sim.node')
recorder = partial(_run, 'cmpsp_ros.nodes.recording.recorder')
viewer = partial(_run, 'cmpsp_ros.nodes.viewer')
