"""Methods in their closed loops, in turn, and their longest steps."""

import numpy as np
import pytest

from benchmarks.common import BenchError
from benchmarks.loops import MethodComparison, Ratios, Timed, close_loop, compare
from benchmarks.methods.ours import OURS, CondensedDaqp
from benchmarks.results import COMPARED_STEPS

STEPS = 6


class Watched(CondensedDaqp):
    """Notes what it is asked, in the order of all that share the list."""

    def __init__(self, task, name, notes):
        super().__init__(task)
        self.name, self.notes = name, notes

    def prepare(self, steps):
        self.notes.append((self.name, 'prepare', steps))

    def begin(self, steps):
        self.notes.append((self.name, 'begin', steps))

    def step(self, pose, U, durations):
        self.notes.append((self.name, 'step', len(durations)))
        return super().step(pose, U, durations)


class Lazy(Watched):
    """Does nothing, which is fast and wrong."""

    def step(self, pose, U, durations):
        return U


class Broken(Watched):
    def prepare(self, steps):
        raise BenchError('it has no compiler')


@pytest.mark.parametrize('make', OURS)
def test_ours_arrive(task, make):
    method = make(task)
    for steps in range(COMPARED_STEPS, 0, -1):
        method.prepare(steps)
    loop = close_loop(task, method, COMPARED_STEPS)
    assert task.failure(task.outcome(loop.wheel_speeds)) == ''
    assert loop.times.shape == (COMPARED_STEPS,)
    assert (loop.times > 0.0).all()
    again = close_loop(task, method, COMPARED_STEPS)
    np.testing.assert_array_equal(again.wheel_speeds, loop.wheel_speeds)


def test_methods_take_turns(task):
    notes, told = [], []
    methods = [Watched(task, name, notes) for name in 'ab']
    found = compare(task, methods, STEPS, 3, lambda: told.append(1))
    assert [name for name, what, size in notes if (what, size) == ('step', 1)] == list('abababab')
    assert [size for name, what, size in notes if (name, what) == ('a', 'prepare')] == [
        6,
        5,
        4,
        3,
        2,
        1,
    ]
    assert len(told) == 2 + 2 * 3
    assert [each.name for each in found.timed] == ['a', 'b']
    assert found.ratios('a', 'a') == Ratios(1.0, 1.0)
    assert found.timed[1].times.shape == (3, STEPS)
    assert (found.timed[1].first.count, found.timed[1].loop.count) == (3, 18)
    assert found.timed[0].outcome == found.timed[1].outcome


def test_what_does_not_solve_the_task_is_not_timed(task):
    methods = [CondensedDaqp(task), Lazy(task, 'lazy', []), Broken(task, 'broken', [])]
    found = compare(task, methods, STEPS, 1)
    assert [each.name for each in found.timed] == ['condensed + daqp']
    assert 'misses the goal' in found.left_out['lazy']
    assert found.left_out['broken'] == 'it has no compiler'


def test_without_a_baseline_there_is_no_comparison(task):
    with pytest.raises(BenchError, match='lazy: it misses the goal'):
        compare(task, [Lazy(task, 'lazy', []), CondensedDaqp(task)], STEPS, 1)


def test_ratios_are_medians_of_quotients_in_the_same_step(task):
    outcome = task.outcome(task.guess(2))
    one = Timed('one', outcome, np.array([[1.0, 10.0], [2.0, 10.0], [3.0, 10.0]]))
    other = Timed('other', outcome, np.array([[2.0, 5.0], [8.0, 10.0], [3.0, 50.0]]))
    found = MethodComparison(2, 3, [one, other], {})
    assert found.ratios('other', 'one') == Ratios(2.0, 1.5)
    assert found.ratios('one', 'other') == Ratios(0.5, 0.75)
    assert found.ratios('one', 'third') is None
    assert found.ratios('third', 'one') is None
