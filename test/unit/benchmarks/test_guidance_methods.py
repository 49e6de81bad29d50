"""Control steps as the guidance law does them."""

import numpy as np
import pytest

from benchmarks.errors import BenchError
from benchmarks.families.timing import close_loop
from benchmarks.methods.guidance_methods import FullStep, Law
from cmpsp_ros.studies.closed_loop import drive

STEPS = 50


@pytest.mark.parametrize('make', [FullStep, Law])
def test_it_drives_as_the_law_drives(task, make):
    decisions = list(drive(task.settings, task.pose))[:-1]
    wanted = [decision.wheel_speeds for decision in decisions]
    found = close_loop(task, make(task), STEPS).wheel_speeds
    np.testing.assert_array_equal(found[:-1], wanted)


def test_no_room_between_few_samples(task):
    with pytest.raises(BenchError, match='too close to'):
        close_loop(task, FullStep(task), 5)


@pytest.mark.parametrize('make', [FullStep, Law])
def test_horizons_may_change_from_run_to_run(task, make):
    method = make(task)
    first = close_loop(task, method, STEPS).wheel_speeds
    assert len(close_loop(task, method, 2 * STEPS).wheel_speeds) == 2 * STEPS + 1
    np.testing.assert_array_equal(close_loop(task, method, STEPS).wheel_speeds, first)
