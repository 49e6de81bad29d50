"""Odometry that stays away, by a clock that may jump."""

from cmpsp_ros.nodes.guidance.odometry_watchdog import Silence

SECOND = 1_000_000_000


def test_before_the_first_odometry_there_is_no_silence():
    silence = Silence()
    assert silence.age(5 * SECOND) is None
    assert not silence.is_longer_than(0.5, 5 * SECOND)
    assert not silence.goes_on(0.5, 5 * SECOND)
    assert not silence.goes_on(0.5, 6 * SECOND)


def test_it_goes_on_when_it_is_seen_at_two_times():
    silence = Silence()
    silence.end(SECOND)
    assert silence.age(3 * SECOND) == 2.0
    assert not silence.goes_on(0.5, 3 * SECOND)
    # A clock that stands is no second look.
    assert not silence.goes_on(0.5, 3 * SECOND)
    assert silence.goes_on(0.5, 3 * SECOND + 1)


def test_odometry_between_two_looks_ends_it():
    silence = Silence()
    silence.end(0)
    assert not silence.goes_on(0.5, SECOND)
    silence.end(SECOND)
    assert not silence.goes_on(0.5, SECOND + 1)
    assert not silence.goes_on(0.5, 2 * SECOND)
    assert silence.goes_on(0.5, 2 * SECOND + 1)
