"""A few of the runs that soak and crowd make by the hundred."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

SOAK = Path(__file__).with_name('soak.py')


@pytest.mark.timeout(300)
@pytest.mark.usefixtures('ros_domain')
def test_memory_and_descriptors_stay_as_they_are_from_run_to_run():
    """More of the same: `python test/integration/guidance/soak.py --minutes 60`."""
    command = [sys.executable, SOAK, '--minutes', '1.5', '--every', '4']
    said = subprocess.run(command, capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stdout + said.stderr
    last = json.loads(said.stdout.splitlines()[-1])
    assert (last['runs'], last['grown'], last['codes']) == (9, [], [0, 0])


CROWD = Path(__file__).with_name('crowd.py')


@pytest.mark.slow
@pytest.mark.timeout(300)
@pytest.mark.usefixtures('ros_domain')
def test_on_a_busy_computer_no_moving_disc_is_touched():
    """More of the same: `python test/integration/guidance/crowd.py --runs 50`."""
    command = [sys.executable, CROWD, '--runs', '3']
    said = subprocess.run(command, capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stdout + said.stderr
    last = json.loads(said.stdout.splitlines()[-1])
    assert (last['runs'], last['clear']) == (3, 3)
