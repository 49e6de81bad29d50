"""Random streams of odometry and parameter files, with every warning an error.

`FUZZ_COUNT=10000 make test-all PYTEST_ARGS=test/unit/guidance/test_fuzz.py` tries as many.
"""

import os
from pathlib import Path

import pytest

UNIT = Path(__file__).parents[1]
MANY = int(os.environ.get('FUZZ_COUNT', '150'))


def counts(few):
    """As few examples in a fast test, and many in a slow one."""
    slow = [pytest.mark.slow, pytest.mark.timeout(600 + MANY)]
    return pytest.mark.parametrize('count', [few, pytest.param(MANY, marks=slow)])


@counts(15)
@pytest.mark.ros
@pytest.mark.filterwarnings('error')
def test_any_odometry_is_refused_or_answered_safely(program, count):
    outcomes = program(UNIT / 'guidance' / 'fuzz.py').fuzz(count, 3)
    assert outcomes['streams'] == count
    all_of_them = {'nominal', 'elastic', 'stop', 'refused', 'not due'}
    assert (all_of_them if count == MANY else {'nominal'}) <= outcomes.keys()


@counts(40)
@pytest.mark.filterwarnings('error')
def test_any_parameters_are_refused_or_answered_safely(program, tmp_path, count):
    outcomes = program(UNIT / 'parameters' / 'fuzz.py').fuzz(count, 9, tmp_path)
    assert outcomes['files'] == count
    assert ({'nominal', 'refused'} if count == MANY else {'refused'}) <= outcomes.keys()
