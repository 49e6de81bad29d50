"""A few hundred of the streams and parameter files that the fuzzers make by the thousand."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

UNIT = Path(__file__).parents[1]


@pytest.mark.parametrize(
    ('program', 'seed', 'outcomes'),
    [
        ('guidance/fuzz.py', 3, {'nominal', 'elastic', 'stop', 'refused', 'not due'}),
        ('parameters/fuzz.py', 5, {'nominal', 'elastic', 'refused'}),
    ],
)
def test_any_input_is_refused_or_answered_safely(program, seed, outcomes):
    """More of the same: `python test/unit/guidance/fuzz.py --count 10000`."""
    command = [sys.executable, UNIT / program, '--count', '150', '--seed', str(seed)]
    said = subprocess.run(command, capture_output=True, text=True, check=False)
    assert said.returncode == 0, said.stderr
    assert outcomes <= json.loads(said.stdout).keys()
