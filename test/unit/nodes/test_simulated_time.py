"""Simulated time by when messages were published."""

from cmpsp_ros.nodes.simulated_time import SimulatedTime


def test_it_is_that_told_last_when_a_message_left():
    clock = SimulatedTime()
    assert clock.at(5) is None
    clock.tell(10, 1000)
    clock.tell(20, 2000)
    assert [clock.at(each) for each in (5, 10, 19, 20, 99)] == [1000, 1000, 1000, 2000, 2000]


def test_a_clock_message_that_comes_late_takes_its_place():
    clock = SimulatedTime()
    clock.tell(10, 1000)
    clock.tell(30, 3000)
    clock.tell(20, 2000)
    assert clock.at(25) == 2000
    assert clock.at(35) == 3000
