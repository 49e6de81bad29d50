"""The simulator as a process."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture
def simulate(spawn):
    """Start a simulator: `simulate(key=value, remaps=[...])`."""

    def start(parameters=None, *more):
        given = [f'{key}:={value}' for key, value in (parameters or {}).items()]
        flags = [flag for each in given for flag in ('-p', each)]
        command = [sys.executable, '-m', 'cmpsp_ros.nodes.sim.node', '--ros-args', *flags, *more]
        return spawn(command)

    return start
