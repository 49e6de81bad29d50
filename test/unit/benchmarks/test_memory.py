"""Resident memory, as Linux tells it."""

import pytest

from benchmarks.errors import BenchError
from benchmarks.families.memory import resident


def test_of_this_process_it_is_that_of_what_it_holds():
    before = resident()
    held = bytearray(b'x' * 100_000_000)
    grown = resident() - before
    assert len(held) == 100_000_000
    assert 50.0 < grown < 300.0


def test_of_no_process():
    with pytest.raises(BenchError, match='/proc/0/status'):
        resident(0)
