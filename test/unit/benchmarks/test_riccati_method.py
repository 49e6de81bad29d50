"""The compiled iteration by itself."""

import numpy as np
import pytest

from benchmarks.methods.condensed_method import CondensedDaqp
from benchmarks.methods.riccati_method import RiccatiActiveSet


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


def test_room_grows_with_the_horizon(task):
    method = RiccatiActiveSet(task)
    found = {}
    for steps in (5, 9, 5):
        method.prepare(steps)
        method.begin(steps)
        U = method.step(task.pose, task.guess(steps), task.durations(steps))
        np.testing.assert_allclose(U, found.setdefault(steps, U), atol=1e-9)
