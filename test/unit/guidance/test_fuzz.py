"""A few hundred of the streams and parameter files that the fuzzers make by the thousand."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

UNIT = Path(__file__).parents[1]


def test_any_odometry_is_refused_or_answered_safely(program):
    outcomes = program(UNIT / 'guidance' / 'fuzz.py').fuzz(15, 3)
    assert outcomes['streams'] == 15
    assert outcomes['nominal'] > 0


def test_any_parameters_are_refused_or_answered_safely(program, tmp_path):
    outcomes = program(UNIT / 'parameters' / 'fuzz.py').fuzz(40, 5, tmp_path)
    assert outcomes['files'] == 40
    assert outcomes['refused'] > 0


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    ('path', 'seed', 'outcomes'),
    [
        ('guidance/fuzz.py', 3, {'nominal', 'elastic', 'stop', 'refused', 'not due'}),
        ('parameters/fuzz.py', 9, {'nominal', 'elastic', 'refused'}),
    ],
)
def test_any_input_is_refused_or_answered_safely(path, seed, outcomes):
    """More of the same: `python test/unit/guidance/fuzz.py --count 10000`."""
    command = [sys.executable, UNIT / path, '--count', '150', '--seed', str(seed)]
    said = subprocess.run(command, capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stderr
    assert outcomes <= json.loads(said.stdout).keys()
