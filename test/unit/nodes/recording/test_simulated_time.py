"""Simulated time by when messages were published."""

import pytest
from rclpy.serialization import serialize_message
from rclpy.time import Time
from rosgraph_msgs.msg import Clock

from cmpsp_ros.nodes.recording.received import PATIENCE, Received, SimulatedTime

NOW = 100


@pytest.fixture
def time():
    return SimulatedTime()


def tick(published, told):
    raw = serialize_message(Clock(clock=Time(nanoseconds=told).to_msg()))
    return Received(NOW, published, '/clock', raw)


def said(published):
    return Received(NOW, published, '/said', b'')


def dated(pairs):
    return [(stamp, each.topic, each.published) for stamp, each in pairs]


def test_it_is_that_told_last_when_a_message_left(time):
    came = [said(25), said(5), tick(10, 1000), said(15), tick(20, 2000), said(20), tick(30, 3000)]
    assert dated(time.date(came, NOW)) == [
        (1000, '/said', 5),
        (1000, '/clock', 10),
        (1000, '/said', 15),
        (2000, '/clock', 20),
        (2000, '/said', 20),
        (2000, '/said', 25),
        (3000, '/clock', 30),
    ]


def test_a_message_waits_for_what_the_clock_told_before_it_left(time):
    assert dated(time.date([tick(10, 1000), said(35)], NOW)) == [(1000, '/clock', 10)]
    assert dated(time.date([tick(20, 2000)], NOW)) == [(2000, '/clock', 20)]
    late = [tick(30, 3000), tick(40, 4000)]
    assert (3000, '/said', 35) in dated(time.date(late, NOW))
    assert time.date([], NOW, all_=True) == []


def test_where_time_stands_still_it_waits_no_longer(time):
    time.date([tick(10, 1000), said(35)], NOW)
    assert time.date([], NOW + PATIENCE) == []
    assert dated(time.date([], NOW + PATIENCE + 1)) == [(1000, '/said', 35)]


def test_at_the_end_nothing_waits(time):
    time.date([tick(10, 1000), said(35)], NOW)
    assert dated(time.date([said(40)], NOW, all_=True)) == [
        (1000, '/said', 35),
        (1000, '/said', 40),
    ]


def test_without_a_clock_all_waits_and_was_at_the_beginning(time):
    assert time.date([said(5)], NOW + 2 * PATIENCE) == []
    assert dated(time.date([], NOW, all_=True)) == [(0, '/said', 5)]
