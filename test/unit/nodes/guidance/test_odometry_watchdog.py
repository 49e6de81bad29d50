"""Odometry that stays away, by a clock that may jump."""

from cmpsp_ros.nodes.guidance.inputs.odometry import OdometryWatchdog

SECOND = 1_000_000_000


def test_before_the_first_odometry_there_is_no_silence():
    watchdog = OdometryWatchdog()
    assert watchdog.age(5 * SECOND) is None
    assert not watchdog.is_longer_than(0.5, 5 * SECOND)
    assert not watchdog.goes_on(0.5, 5 * SECOND)
    assert not watchdog.goes_on(0.5, 6 * SECOND)


def test_it_goes_on_when_it_is_seen_at_two_times():
    watchdog = OdometryWatchdog()
    watchdog.end(SECOND)
    assert watchdog.age(3 * SECOND) == 2.0
    assert not watchdog.goes_on(0.5, 3 * SECOND)
    # A clock that stands is no second look.
    assert not watchdog.goes_on(0.5, 3 * SECOND)
    assert watchdog.goes_on(0.5, 3 * SECOND + 1)


def test_odometry_between_two_looks_ends_it():
    watchdog = OdometryWatchdog()
    watchdog.end(0)
    assert not watchdog.goes_on(0.5, SECOND)
    watchdog.end(SECOND)
    assert not watchdog.goes_on(0.5, SECOND + 1)
    assert not watchdog.goes_on(0.5, 2 * SECOND)
    assert watchdog.goes_on(0.5, 2 * SECOND + 1)
