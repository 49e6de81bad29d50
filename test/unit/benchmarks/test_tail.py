"""Many control steps, and the longest of them."""

import gc

import numpy as np
import pytest

from benchmarks.families.tail import Tail, loops, tails
from benchmarks.methods.condensed_method import CondensedDaqp


class Watching(CondensedDaqp):
    """Notes whether the garbage collector is on."""

    def __init__(self, task, notes):
        super().__init__(task)
        self.notes = notes

    def step(self, pose, U, durations):
        self.notes.append((gc.isenabled(), gc.get_freeze_count() > 0))
        return super().step(pose, U, durations)


def test_ratio_of_the_percentile_to_the_median():
    times = np.concatenate([np.full(1990, 2.0), np.full(10, 9.0)])
    found = Tail('method', times, np.full(1000, 3.0))
    assert found.ratio == pytest.approx(4.5)
    assert found.ratio_again == pytest.approx(1.0)
    assert Tail('method', times[:500], times).ratio is None


def test_whole_loops_with_the_collector_off(task):
    notes, told = [], []
    found = tails(task, [Watching(task, notes)], 3, 7, lambda: told.append(1))
    assert [each.times.shape for each in found] == [(9,)]
    assert [each.again.shape for each in found] == [(9,)]
    assert len(told) == loops(7, 3) == 3
    assert set(notes) == {(False, True)}
    assert gc.isenabled()
    assert gc.get_freeze_count() == 0
