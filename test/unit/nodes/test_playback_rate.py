"""Bag time from wall time, with no clock but the test's."""

from __future__ import annotations

import pytest

from cmpsp_ros.nodes.playback import PlaybackRate


@pytest.mark.parametrize('rate', [0.5, 1.0, 4.0])
def test_it_runs_at_its_rate_and_stands_still_while_paused(rate):
    playback_rate = PlaybackRate(rate)
    playback_rate.go_to(1000, 50)
    assert (playback_rate.paused, playback_rate.stamp(90)) == (True, 1000)
    playback_rate.resume(100)
    assert (playback_rate.paused, playback_rate.stamp(300)) == (False, 1000 + 200 * rate)
    playback_rate.pause(300)
    assert (playback_rate.paused, playback_rate.stamp(900)) == (True, 1000 + 200 * rate)
    playback_rate.resume(900)
    playback_rate.resume(1000)
    assert playback_rate.stamp(1100) == 1000 + 400 * rate


def test_a_jump_keeps_it_running_or_standing():
    playback_rate = PlaybackRate(2.0)
    playback_rate.resume(0)
    playback_rate.go_to(500, 10)
    assert playback_rate.stamp(20) == 520
    playback_rate.pause(20)
    playback_rate.go_to(0, 30)
    assert playback_rate.stamp(90) == 0


def test_how_long_to_wait():
    playback_rate = PlaybackRate(4.0)
    playback_rate.resume(0)
    assert playback_rate.until(400, 0) == 100
    assert playback_rate.until(400, 60) == 40
    assert playback_rate.until(400, 200) == 0
