"""Methods in their closed loops, in turn, and their longest steps."""

import numpy as np
import pytest

from benchmarks.common import BenchError
from benchmarks.loops import MethodComparison, Ratios, Timed, close_loop, compare
from benchmarks.methods.ours import OURS, CondensedDaqp, FullStep, Law, RiccatiActiveSet
from benchmarks.results import COMPARED_STEPS
from cmpsp_ros.studies.closed_loop import drive

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


def test_ratios_are_medians_of_quotients_in_the_same_step(task):
    outcome = task.outcome(task.guess(2))
    one = Timed('one', outcome, np.array([[1.0, 10.0], [2.0, 10.0], [3.0, 10.0]]))
    other = Timed('other', outcome, np.array([[2.0, 5.0], [8.0, 10.0], [3.0, 50.0]]))
    found = MethodComparison(2, 3, [one, other], {})
    assert found.ratios('other', 'one') == Ratios(2.0, 1.5)
    assert found.ratios('one', 'other') == Ratios(0.5, 0.75)
    assert found.ratios('one', 'third') is None
    assert found.ratios('third', 'one') is None


@pytest.mark.parametrize('steps', [7, 50])
def test_two_iterations_are_those_of_the_baseline(task, steps):
    """Warm starts, too: each gets what the other one has made."""
    fast, slow = RiccatiActiveSet(task), CondensedDaqp(task)
    fast.prepare(steps)
    fast.begin(steps)
    U, pose, durations = task.guess(steps), task.pose, task.durations(steps)
    for k in range(3):
        wanted = slow.step(pose, U, durations[k:])
        found = fast.step(pose, U, durations[k:])
        np.testing.assert_allclose(found, wanted, atol=1e-6)
        pose = task.settings.robot.roll_out(pose, found[:1], durations[:1])[-1]
        U = wanted[1:]


TASK_STEPS = 50


@pytest.mark.parametrize('make', [FullStep, Law])
def test_it_drives_as_the_law_drives(task, make):
    decisions = list(drive(task.settings, task.pose))[:-1]
    wanted = [decision.wheel_speeds for decision in decisions]
    found = close_loop(task, make(task), TASK_STEPS).wheel_speeds
    np.testing.assert_array_equal(found[:-1], wanted)


@pytest.mark.parametrize('make', [FullStep, Law])
def test_horizons_may_change_from_run_to_run(task, make):
    method = make(task)
    first = close_loop(task, method, TASK_STEPS).wheel_speeds
    assert len(close_loop(task, method, 2 * TASK_STEPS).wheel_speeds) == 2 * TASK_STEPS + 1
    np.testing.assert_array_equal(close_loop(task, method, TASK_STEPS).wheel_speeds, first)
