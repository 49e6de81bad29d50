"""Case 3, and a small benchmark of it."""

import pytest

from benchmarks.results import Order
from benchmarks.run import run
from benchmarks.task import Task


@pytest.fixture(scope='session')
def task():
    return Task.case3()


@pytest.fixture(scope='session')
def results():
    """Two runs with four steps and every solver that is installed."""
    small = {'steps': 4, 'horizons': (4, 6), 'robots': ['jackal'], 'long_horizons': (25, 50)}
    return run(Order(['case3'], runs=2, tail=10, peers=True, **small))
