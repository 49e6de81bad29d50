"""Bag time from wall time, with no clock but the test's."""

from __future__ import annotations

import pytest

from cmpsp_ros.nodes.playback.playback_rate import Pace


@pytest.mark.parametrize('rate', [0.5, 1.0, 4.0])
def test_it_runs_at_its_rate_and_stands_still_while_paused(rate):
    pace = Pace(rate)
    pace.go_to(1000, 50)
    assert (pace.paused, pace.stamp(90)) == (True, 1000)
    pace.resume(100)
    assert (pace.paused, pace.stamp(300)) == (False, 1000 + 200 * rate)
    pace.pause(300)
    assert (pace.paused, pace.stamp(900)) == (True, 1000 + 200 * rate)
    pace.resume(900)
    pace.resume(1000)
    assert pace.stamp(1100) == 1000 + 400 * rate


def test_a_jump_keeps_it_running_or_standing():
    pace = Pace(2.0)
    pace.resume(0)
    pace.go_to(500, 10)
    assert pace.stamp(20) == 520
    pace.pause(20)
    pace.go_to(0, 30)
    assert pace.stamp(90) == 0


def test_how_long_to_wait():
    pace = Pace(4.0)
    pace.resume(0)
    assert pace.until(400, 0) == 100
    assert pace.until(400, 60) == 40
    assert pace.until(400, 200) == 0
