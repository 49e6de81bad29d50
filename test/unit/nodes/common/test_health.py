"""What a node says of its own state, and when."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.time import Time

from cmpsp_ros.nodes.common.health import Health, Report
from cmpsp_ros.nodes.guidance.diagnostics import StepTimes


class FakeNode:
    """As much of a node as `Health` uses; timers are called by hand."""

    def __init__(self):
        self.published, self.timers = [], {}

    def create_publisher(self, kind, topic, depth):
        self.topic = topic
        return SimpleNamespace(publish=self.published.append)

    def create_timer(self, period, callback, clock):
        self.timers[period] = callback

    def get_name(self):
        return 'guidance'

    def get_namespace(self):
        return '/r1'

    def get_fully_qualified_name(self):
        return '/r1/guidance'

    def get_clock(self):
        return SimpleNamespace(now=lambda: Time(nanoseconds=1_000_000_002))


@pytest.fixture
def node():
    return FakeNode()


def report(mark='a', **values):
    return Report(DiagnosticStatus.WARN, 'So so.', (mark,), lambda: values)


def test_a_report_becomes_a_status_with_the_node_s_full_name(node):
    Health(node, lambda: report(age=0.1 + 0.2, state='active', misses=3)).publish()
    (array,) = node.published
    assert node.topic == '/diagnostics'
    assert Time.from_msg(array.header.stamp).nanoseconds == 1_000_000_002
    (status,) = array.status
    assert (status.name, status.hardware_id) == ('/r1/guidance: guidance', 'r1')
    assert (status.level, status.message) == (DiagnosticStatus.WARN, 'So so.')
    assert {each.key: each.value for each in status.values} == {
        'age': '0.30000000000000004',
        'state': 'active',
        'misses': '3',
    }


def test_it_is_published_once_a_second_and_at_a_change(node):
    reports = [report('a')]
    Health(node, lambda: reports[-1])
    slow, fast = node.timers[1.0], node.timers[0.1]
    fast()
    fast()
    assert len(node.published) == 1
    slow()
    assert len(node.published) == 2
    reports.append(report('a', age=1.0))
    fast()
    assert len(node.published) == 2
    reports.append(report('b'))
    fast()
    fast()
    assert len(node.published) == 3


def test_figures_are_worked_out_only_for_what_is_published(node):
    asked = []
    Health(node, lambda: Report(DiagnosticStatus.OK, '', ('a',), lambda: asked.append(1) or {}))
    for _ in range(5):
        node.timers[0.1]()
    assert len(asked) == len(node.published) == 1


def test_no_step_no_times():
    assert StepTimes().values() == {}


def test_times_are_summed_up_and_missed_deadlines_counted():
    times = StepTimes()
    for milliseconds in (*range(1, 100), 200.0, 200.1):
        times.add(float(milliseconds), float(milliseconds), 0.2, 0.0)
    values = times.values()
    assert values['step_ms_p50'] == 51.0
    assert values['step_ms_p95'] == 96.0
    assert values['step_ms_max'] == 200.1
    assert values['deadline_misses'] == 1


def test_a_step_that_outlasts_the_period_is_told_until_the_next_that_does_not():
    times = StepTimes()
    assert times.warnings() == []
    times.add(200.5, 200.5, 0.2, 0.0)
    assert times.warnings() == [
        'The last control step took 200.5 ms of the 200.0 ms until the next.'
    ]
    times.add(200.0, 200.0, 0.2, 0.0)
    assert times.warnings() == []


def test_times_are_those_of_the_latest_steps_but_no_missed_deadline_is_forgotten():
    times = StepTimes()
    times.add(500.0, 500.0, 0.2, 0.0)
    for _ in range(1000):
        times.add(1.0, 1.0, 0.2, 0.0)
    assert times.values()['step_ms_max'] == 1.0
    assert times.values()['deadline_misses'] == 1


def test_a_command_that_leaves_late_is_a_missed_deadline_however_short_its_step():
    times = StepTimes()
    times.add(5.0, 850.0, 0.2, 0.0)
    times.add(5.0, 290.0, 0.2, 0.1)
    times.add(5.0, 310.0, 0.2, 0.1)
    values = times.values()
    assert values['deadline_misses'] == 2
    assert values['odometry_to_command_ms_max'] == 850.0


def test_a_command_that_was_not_sent_is_a_missed_deadline_by_any_clock():
    times = StepTimes()
    # In simulated time twice as fast as the computer's clock.
    times.add(150.0, 300.0, 0.2, 0.15, is_late=True)
    assert times.values()['deadline_misses'] == 1


@pytest.mark.parametrize(('delay', 'said'), [(0.0, 1), (0.04, 0), (0.06, 0)])
def test_a_delay_that_nobody_knows_of_is_told_with_its_value(delay, said):
    times = StepTimes()
    for _ in range(9):
        times.add(5.0, 50.0, 0.2, delay)
    assert times.warnings() == []
    times.add(5.0, 50.0, 0.2, delay)
    sentence = 'Commands leave 50 ms after their odometry: command_delay should be 0.050 s or more.'
    assert times.warnings() == [sentence] * said


def with_ages(ages, delay=0.0):
    times = StepTimes()
    for age in ages:
        times.hear(age)
    for _ in range(10):
        times.add(5.0, float(ages[-1]) + 5.0, 0.2, delay)
    return times


def test_how_late_odometry_comes_is_told_with_the_delay_to_set():
    values = with_ages([*range(1, 100), 200.0]).values()
    assert values['odometry_latency_ms_min'] == 1.0
    assert values['odometry_latency_ms_p50'] == 50.5
    assert values['odometry_latency_ms_p99'] == pytest.approx(100.01)
    assert values['command_delay_measured'] == pytest.approx(0.205)


def test_a_clock_that_is_behind_is_told_apart_from_a_delay_that_varies():
    said = 'Odometry is 150 ms old or more when it comes: the clock of the robot is behind, or the'
    assert any(each.startswith(said) for each in with_ages([150.0, 160.0]).warnings())
    assert not any('clock' in each for each in with_ages([1.0, 150.0, 160.0]).warnings())
    assert with_ages([150.0, 160.0], delay=0.15).warnings() == []


def test_a_clock_that_is_ahead_is_told_and_a_tick_of_a_simulation_is_not():
    said = ['Odometry comes up to 50 ms before its time: the clock of the robot is ahead.']
    assert with_ages([-50.0, -40.0]).warnings() == said
    assert with_ages([-20.0, 0.0]).warnings() == []
    assert with_ages([-50.0]).values()['command_delay_measured'] == 0.0
