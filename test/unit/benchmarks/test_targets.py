"""Targets beside what was found."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.families.hard_cases import HardCase
from benchmarks.families.horizons import Growth
from benchmarks.families.long_horizons import LongHorizons, LongStep
from benchmarks.families.many_plans import Plans
from benchmarks.families.robot_drives import RobotDrive
from benchmarks.families.tail import Tail
from benchmarks.families.timing import Timed
from benchmarks.over_dds.latency import Latency
from benchmarks.tables import tables
from benchmarks.targets import pace, targets

# What they share takes long to make.
pytestmark = [pytest.mark.slow, pytest.mark.xdist_group('bench_results')]

BARE, FULL = 'riccati active set', 'riccati active set, full step'


@pytest.fixture
def known(task, results):
    """Times that are known, instead of those of the run."""
    outcome = task.outcome(task.guess(2))
    times = {'condensed + daqp': 100.0, BARE: 8.0, FULL: 24.0, 'sqpmethod + piqp': 400.0}
    timed = [Timed(name, outcome, np.full((3, 2), time)) for name, time in times.items()]
    own = np.full(200, 0.25)
    # Three of 200 are more than the 99th percentile leaves out.
    first = np.arange(200) < 3
    total = np.where(first, 9.0, 1.25)
    long = [LongStep(N, 0.5, 5.0, 100.0, {'warm': 2.0 * N, 'cold': 4.0}, {}) for N in (50, 100)]
    return replace(
        results,
        robots=[drive('fast', [[40.0, 1.0, 2.0]]), drive('slow', [[60.0, 2.0, 12.0]] * 100)],
        models=[
            drive('differential drive', [[1.0, 1.0, 1.0]]),
            drive('car', [[1.0, 2.0, 9.0]]),
            drive('differential drive, limited acceleration', [[1.0, 1.0, 1.0]]),
            drive('car, limited acceleration', [[9.0, 4.0, 2.0]]),
        ],
        long_horizons=LongHorizons(long, {}),
        comparison=replace(results.comparison, timed=timed),
        hard=[hard_case('easy', [[0.1, 0.1, 0.9]] * 3), hard_case('hard', [[0.8, 0.3, 0.3]] * 3)],
        growth=[Growth(BARE, [100, 400], [1.0, 900.0], 1.58)],
        tails=[Tail(BARE, np.full(2000, 8.0), np.full(2000, 9.0))],
        plans=[Plans(1, np.ones(3), np.ones(3)), Plans(8, np.ones(3), np.full(3, 1100.0))],
        latency=Latency(
            1, total, own, first, np.diff(own), 0.0, np.array([1.0, 1.2, 9.0]), 100.0, 100.0
        ),
    )


def drive(name, times):
    return RobotDrive(name, np.array(times), np.ones(3, int), {'nominal': 3}, 0.0)


def hard_case(name, times):
    return HardCase(name, np.array(times), elastic=1)


def test_what_holds_and_what_does_not(known):
    assert [(each.found, each.holds) for each in targets(known)] == [
        (60.0, False),
        (60.0, False),
        (12.0, False),
        (pytest.approx(1.0), True),
        (pytest.approx(0.08), True),
        (pytest.approx(0.08), True),
        (pytest.approx(0.02), True),
        (pytest.approx(0.02), True),
        (pytest.approx(3.0), False),
        (pytest.approx(3.0), False),
        (1.58, False),
        (0.9, True),
        (0.3, False),
        (0.9, True),
        (1.0, True),
        (1.0, True),
        (None, None),
        (None, None),
        (None, None),
        (None, None),
        (2.0, True),
        (4.0, False),
        (1.1, False),
        (1.25, False),
        (9.0, False),
        (1.25, True),
        (0.25, True),
        (1.2, True),
    ]


def test_each_says_what_it_is(known):
    said = [each.what for each in targets(known)]
    assert len(set(said)) == len(said)
    assert said[4] == 'riccati active set / condensed + daqp: first step'


def test_how_slow_the_machine_is(known):
    comparison = known.comparison
    timed = [replace(each, times=each.times * 5.6) for each in comparison.timed]
    slower = replace(known, comparison=replace(comparison, steps=50, timed=timed))
    assert pace(slower) == pytest.approx(2.0)
    assert '2.00 times as long' in next(tables(slower)).note
    bare = replace(slower, comparison=replace(slower.comparison, timed=timed[:1]))
    # Nor can it be told from a horizon of another length.
    short = replace(known, comparison=replace(comparison, steps=4))
    for each in (bare, short):
        assert pace(each) is None
        assert 'times as long' not in next(tables(each)).note


def test_what_was_not_measured(known):
    bare = replace(known.comparison, timed=known.comparison.timed[:1])
    nothing = {
        'robots': [],
        'models': [],
        'long_horizons': LongHorizons([], {}),
        'hard': [],
        'growth': [],
    }
    without = replace(known, comparison=bare, **nothing, tails=[], plans=[], latency=None)
    assert {each.holds for each in targets(without)} == {None}


def test_the_longest_step_of_a_hard_case_is_not_one_that_was_held_up():
    case = hard_case('held up', [[0.8, 0.3, 0.3], [0.7, 5.0, 0.3], [0.9, 0.3, 0.3]])
    assert case.longest == 0.8
