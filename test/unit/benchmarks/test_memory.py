"""Resident memory and processor time."""

import os

import pytest

from benchmarks.errors import BenchError
from benchmarks.machine import processor_time, resident


def test_of_this_process_it_is_that_of_what_it_holds():
    before = resident()
    held = bytearray(b'x' * 100_000_000)
    grown = resident() - before
    assert len(held) == 100_000_000
    assert 50.0 < grown < 300.0


def test_of_no_process():
    with pytest.raises(BenchError, match='process 99999999: '):
        resident(99_999_999)


def test_processor_time_grows_with_work():
    before = processor_time(os.getpid())
    while processor_time(os.getpid()) < before + 0.05:
        sum(range(10_000))
