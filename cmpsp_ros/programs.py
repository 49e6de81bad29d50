"""Begin and end of the installed programs; a missing package is named with what installs it."""

import atexit
import gc
import os
import sys
import threading
from functools import partial
from importlib import import_module
from typing import Final, NoReturn

_ROS: Final = ('rclpy', 'rmw_', 'rcl_interfaces', 'builtin_interfaces', 'std_srvs')
# Package by the module that is imported.
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


def _run(module: str) -> None:
    """Run `main` of a module.

    Raises:
        SystemExit: A package is not installed: a sentence that says which, and how to install it.
    """
    try:
        import_module(module).main()
    except ModuleNotFoundError as error:
        name = (error.name or '').partition('.')[0]
        if name.startswith(_ROS) or name.endswith('_msgs'):
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


def quick_exit(code: int) -> NoReturn:
    """End the process with an exit code, skipping the teardown of modules.

    With numba the teardown takes a third of a second. Exit handlers, garbage collection and
    flushing of output are done. With other threads running, Python's own exit is used.

    Raises:
        SystemExit: Other threads are running.
    """
    others = [each for each in threading.enumerate() if not each.daemon]
    if others != [threading.main_thread()]:
        sys.exit(code)
    atexit._run_exitfuncs()  # noqa: SLF001 (there is no other way to do it early)
    gc.collect()
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):
            code = code or 1
    os._exit(code)
