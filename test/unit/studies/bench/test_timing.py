"""Methods in their closed loops, in turn."""

import numpy as np
import pytest

from cmpsp_ros.studies.bench.errors import BenchError
from cmpsp_ros.studies.bench.methods import OURS, CondensedDaqp
from cmpsp_ros.studies.bench.timing import close_loop, compare

STEPS = 6


class Watched(CondensedDaqp):
    """Notes what it is asked, in the order of all that share the list."""

    def __init__(self, task, name, notes):
        super().__init__(task)
        self.name, self.notes = name, notes

    def prepare(self, steps):
        self.notes.append((self.name, 'prepare', steps))

    def begin(self):
        self.notes.append((self.name, 'begin', 0))

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
    for steps in range(STEPS, 0, -1):
        method.prepare(steps)
    loop = close_loop(task, method, STEPS)
    assert task.failure(task.outcome(loop.wheel_speeds)) == ''
    assert loop.times.shape == (STEPS,)
    assert (loop.times > 0.0).all()


@pytest.mark.parametrize('make', OURS)
def test_ours_leave_the_warm_start_as_it_is(task, make):
    method, U = make(task), task.guess(STEPS)
    method.prepare(STEPS)
    method.begin()
    improved = method.step(task.pose, U, task.durations(STEPS))
    np.testing.assert_array_equal(U, task.guess(STEPS))
    assert improved.shape == U.shape


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
    assert found.timed[0].first_ratio == found.timed[0].loop_ratio == 1.0
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
