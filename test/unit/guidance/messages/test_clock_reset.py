"""Time that begins again, by the stamps of odometry alone."""

from __future__ import annotations

import pytest

from cmpsp_ros.guidance.messages.clock_reset import TimeJump

SECOND = 1_000_000_000


def test_the_first_odometry_is_no_jump():
    assert TimeJump().back(5 * SECOND) == 0.0


@pytest.mark.parametrize('begin', [0, 7 * SECOND])
def test_it_is_measured_from_one_odometry_to_the_next(begin):
    time = TimeJump()
    steps = [SECOND, 2 * SECOND, -3 * SECOND, 0]
    stamp, jumps = begin, []
    time.back(stamp)
    for step in steps:
        stamp += step
        jumps.append(time.back(stamp))
    assert jumps == [-1.0, -2.0, 3.0, 0.0]
