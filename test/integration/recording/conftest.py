"""The recorder as a process, its bag in a folder of the test."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from recorder_process import RECORDER


@pytest.fixture
def bag(tmp_path):
    return tmp_path / 'bag'


@pytest.fixture
def record(spawn, bag, wait_until):
    """Start the recorder, and wait until it records."""

    def start(*parameters):
        settings = [text for each in (f'output:={bag}', *parameters) for text in ('-p', each)]
        process = spawn([*RECORDER, *settings])
        wait_until(lambda: 'recording to' in process.stderr)
        return process

    return start
