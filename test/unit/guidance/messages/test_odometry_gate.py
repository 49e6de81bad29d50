"""Odometry is used in order, where wheels can have brought the robot, and a while after a fault."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmpsp_ros.guidance import Safety
from cmpsp_ros.guidance.messages import Arrival, OdometryError, OdometryGate, motion_limits
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file

MS = 1_000_000
BEGIN = 100_000 * MS
TICK = 20 * MS
START = (0.0, -9.25, 0.0)
SETTINGS = guidance_settings(TABLE.resolve(load_parameter_file('case3')))
SPEED = SETTINGS.robot.max_speed


def without_check(**changes):
    robot = replace(SETTINGS.robot, **changes)
    return replace(SETTINGS, robot=robot, safety=Safety(max_odom_jump=0.0 if not changes else 0.1))


class Stream:
    """Messages to one gate, each on time unless told otherwise."""

    def __init__(self, settings=SETTINGS):
        self.gate, self.settings, self.now = OdometryGate(), settings, BEGIN

    def hear(self, pose=START, after=TICK, age=0):
        """Treatment of a message: `go on`, `stand`, `ignored`, `again`, or its fault."""
        self.now += after
        try:
            arrival = self.gate.take(self.now - age, np.array(pose), self.now, self.settings)
        except OdometryError as error:
            self.gate.refuse(str(error))
            self.gate.note_stop()
            return str(error)
        if arrival is Arrival.TAKEN:
            return 'stand' if self.gate.fault else 'go on'
        return 'ignored' if arrival is Arrival.IGNORED else 'again'


@pytest.fixture
def stream():
    return Stream()


def moved(x, y=0.0, turn=0.0):
    return START[0] + x, START[1] + y, START[2] + turn


def test_what_wheels_can_drive_goes_on(stream):
    x, heading = 0.0, 0.0
    for _ in range(100):
        assert stream.hear(moved(x, turn=heading)) == 'go on'
        x, heading = x + SPEED * 0.02, heading + SPEED / SETTINGS.robot.half_track * 0.02
    assert stream.gate.counts == {'refused': 0, 'out_of_order': 0, 'repeated': 0}


def test_a_jump_is_told_with_distance_time_and_limit(stream):
    assert stream.hear() == 'go on'
    limit = 1.25 * SPEED * 0.02 + 0.1
    assert stream.hear(moved(10.0)) == (
        f'Odometry jumps by 10 m within 0.020 s: the wheels allow {limit:.3g} m'
        ' (safety.max_odom_jump).'
    )
    stream.hear(moved(10.0))
    assert 'jumps by 2 rad within 0.020 s' in stream.hear(moved(10.0, turn=2.0))


def test_after_a_jump_it_goes_on_from_the_new_pose_when_that_has_lasted_a_control_period(stream):
    stream.hear()
    assert 'jumps by 0.3 m' in stream.hear(moved(0.3))
    # The first consistent message begins the control period of ten more.
    found = [stream.hear(moved(0.3)) for _ in range(12)]
    assert found == ['stand'] * 10 + ['go on'] * 2
    assert stream.gate.counts['refused'] == 1


def test_a_correction_by_centimetres_is_no_fault(stream):
    stream.hear()
    assert stream.hear(moved(0.05, 0.05, 0.1)) == 'go on'


def test_two_sources_in_turn_are_never_consistent(stream):
    stream.hear()
    found = [stream.hear(moved(10.0 * (k % 2), 0.01 * k)) for k in range(1, 200)]
    assert not {'go on', 'stand'} & set(found)


def test_a_second_source_whose_stamps_are_newer_is_no_better(stream):
    """The robot's odometry is then older than the newest, each time."""
    stream.hear(age=15 * MS)
    found = []
    for _ in range(100):
        found.append(stream.hear(moved(10.0), after=TICK // 2))
        found.append(stream.hear(age=15 * MS, after=TICK // 2))
    assert 'go on' not in found
    # What is as old and where the robot is, or older by a long time, does no harm.
    for _ in range(10):
        stream.hear(moved(10.0))
        assert stream.hear(moved(10.0), after=0, age=TICK // 2) == 'ignored'
        assert stream.hear(after=0, age=100_000 * MS) == 'ignored'
    assert stream.hear(moved(10.0)) == 'go on'


def test_a_second_source_of_the_same_stamps_is_a_jump(stream):
    stream.hear()
    assert 'jumps by 10 m within 0.000 s' in stream.hear(moved(10.0), after=0)
    assert stream.gate.counts['repeated'] == 1


def test_any_fault_takes_a_control_period_without_another(stream):
    stream.hear()
    stream.gate.refuse('Odometry has a pose that is not finite.')
    assert [stream.hear() for _ in range(10)] == ['stand'] * 10
    stream.gate.note_stop()
    stream.gate.refuse('Odometry cannot be read.')
    assert [stream.hear() for _ in range(11)] == ['stand'] * 10 + ['go on']


def test_it_does_not_go_on_before_it_was_stopped(stream):
    """The command of a braking robot is held to the end of its period: so long nothing is sent."""
    stream.hear()
    stream.gate.refuse('Odometry cannot be read.')
    assert [stream.hear() for _ in range(30)] == ['stand'] * 30
    stream.gate.note_stop()
    assert stream.hear() == 'go on'
    stream.gate.refuse('Odometry cannot be read.')
    assert [stream.hear() for _ in range(30)] == ['stand'] * 30


def test_the_reason_names_the_fault_and_then_that_it_recovers(stream):
    assert stream.gate.reason(SETTINGS) == ''
    stream.gate.fail('No usable odometry.')
    assert stream.gate.reason(SETTINGS) == 'No usable odometry.'
    stream.hear()
    assert stream.gate.reason(SETTINGS) == (
        'Recovering: odometry must be consistent for 0.2 s (control_period) before the robot goes'
        ' on. No usable odometry.'
    )


def test_a_message_older_than_the_newest_is_ignored_however_old_and_wherever(stream):
    stream.hear()
    for age in (TICK + 1, 400 * MS, 100_000 * MS):
        assert stream.hear(moved(50.0), age=age, after=0) == 'ignored'
    assert stream.hear() == 'go on'
    assert stream.gate.counts == {'refused': 0, 'out_of_order': 3, 'repeated': 0}


def test_the_first_message_and_newer_ones_must_fit_the_clock(stream):
    assert 'Odometry is 1.000 s old (odom_timeout 0.5 s)' in stream.hear(age=1000 * MS)
    stream = Stream()
    stream.hear()
    assert 'Odometry is 0.700 s old' in stream.hear(after=2000 * MS, age=700 * MS)
    assert 'Odometry is 0.700 s ahead' in stream.hear(age=-700 * MS)
    # A stamp of the future does not make the present old.
    assert stream.hear() == 'stand'


def test_where_clock_and_odometry_jump_back_time_begins_again_at_any_place(stream):
    stream.hear()
    stream.hear(after=TICK)
    stream.now = 10 * MS
    assert stream.hear(moved(30.0), after=0) == 'again'
    assert stream.hear(moved(30.0)) == 'go on'


def test_odometry_alone_that_jumps_back_is_ignored_until_it_is_newer(stream):
    """Two robots' clocks differ so: the run must not begin again with every message."""
    stream.hear(age=-400 * MS)
    assert [stream.hear(age=200 * MS) for _ in range(10)] == ['ignored'] * 10
    assert stream.hear(after=500 * MS) == 'go on'


@pytest.mark.parametrize('settings', [without_check(), without_check(max_wheel_speed=math.inf)])
def test_without_a_limit_any_motion_is_allowed(settings):
    stream = Stream(settings)
    stream.hear()
    assert stream.hear(moved(100.0)) == 'go on'


@given(st.floats(0.0, 2.0), st.floats(-math.pi, math.pi), st.floats(-1.0, 1.0))
def test_every_arc_within_the_wheel_limits_is_allowed_at_any_rate(duration, heading, ratio):
    speeds = np.array([SETTINGS.robot.max_wheel_speed, ratio * SETTINGS.robot.max_wheel_speed])
    path = SETTINGS.robot.roll_out(
        np.array([1.0, 2.0, heading]), speeds[None], np.array([duration])
    )
    gate, stamp = OdometryGate(), BEGIN + round(duration * 1e9)
    gate.take(BEGIN, path[0], BEGIN, SETTINGS)
    assert gate.take(stamp, path[1], stamp, SETTINGS) is Arrival.TAKEN
    distance, turn = motion_limits(SETTINGS.robot, np.array([duration, 2.0 * duration]), 0.1)
    assert distance[0] <= distance[1]
    assert turn[0] <= turn[1]
