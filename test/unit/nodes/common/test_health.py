"""A node's report of its own state, and when it is published."""

import time

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.time import Time

from cmpsp_ros.nodes.common.health import Health, Report
from cmpsp_ros.nodes.guidance.diagnostics import StepTimes


@pytest.fixture
def node(monkeypatch, tmp_path):
    """A node that hears itself and nobody else."""
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'OFF')
    monkeypatch.setenv('ROS_LOG_DIR', str(tmp_path))
    context = Context()
    context.init(args=[])
    made = Node('guidance', namespace='/r1', context=context)
    yield made
    made.destroy_node()
    context.try_shutdown()


@pytest.fixture
def until(node):
    """Spin until so many diagnostics have been heard, and return them: `until(count)`."""
    heard, executor = [], SingleThreadedExecutor(context=node.context)
    node.create_subscription(DiagnosticArray, '/diagnostics', heard.append, 10)
    executor.add_node(node)

    def spin(count):
        end = time.monotonic() + 100.0
        while len(heard) < count:
            assert time.monotonic() < end
            executor.spin_once(timeout_sec=0.05)
        return heard

    yield spin
    executor.shutdown()


def report(mark='a', **values):
    return Report(DiagnosticStatus.WARN, 'So so.', (mark,), lambda: values)


def test_a_report_becomes_a_status_with_the_node_s_full_name(node, until):
    begun = node.get_clock().now()
    Health(node, lambda: report(age=0.1 + 0.2, state='active', misses=3)).publish()
    (array,) = until(1)[:1]
    assert Time.from_msg(array.header.stamp).nanoseconds >= begun.nanoseconds
    (status,) = array.status
    assert (status.name, status.hardware_id) == ('/r1/guidance: guidance', 'r1')
    assert (status.level, status.message) == (DiagnosticStatus.WARN, 'So so.')
    shown = {each.key: each.value for each in status.values}
    assert shown == {'age': '0.30000000000000004', 'state': 'active', 'misses': '3'}


def test_it_is_published_again_and_again_and_at_a_change(node, until):
    reports, asked = [report('a')], []
    Health(node, lambda: reports[-1])
    # Of the same state, once a second.
    until(3)
    figures = lambda: asked.append(1) or {}  # noqa: E731
    reports.append(Report(DiagnosticStatus.OK, 'Well.', ('b',), figures))
    heard = until(5)
    # Figures are computed only for what is published; the last may still be on its way.
    assert len(asked) - sum(each.status[0].message == 'Well.' for each in heard) in {0, 1}


def times_of(*steps, ages=(), late=False):
    """Times of steps, each with the time to its command [ms], control period and delay [s]."""
    times = StepTimes()
    for age in ages:
        times.hear(age)
    for each in steps:
        times.add(*each, is_late=late)
    return times


def test_times_are_summed_up_and_missed_deadlines_counted():
    assert StepTimes().values() == {}
    values = times_of(*((float(ms), float(ms), 0.2, 0.0) for ms in (*range(1, 100), 200.0, 200.1)))
    values = values.values()
    assert values['step_ms_p50'] == 51.0
    assert values['step_ms_p95'] == 96.0
    assert values['step_ms_max'] == 200.1
    assert values['deadline_misses'] == 1
    # Times are those of the latest steps, but no missed deadline is forgotten.
    latest = times_of((500.0, 500.0, 0.2, 0.0), *[(1.0, 1.0, 0.2, 0.0)] * 1000).values()
    assert (latest['step_ms_max'], latest['deadline_misses']) == (1.0, 1)
    # A command that leaves late is a missed deadline, however short its step.
    slow = [(5.0, 850.0, 0.2, 0.0), (5.0, 290.0, 0.2, 0.1), (5.0, 310.0, 0.2, 0.1)]
    values = times_of(*slow).values()
    assert (values['deadline_misses'], values['odometry_to_command_ms_max']) == (2, 850.0)
    # One that was not sent is by any clock: simulated time may be twice as fast.
    assert times_of((150.0, 300.0, 0.2, 0.15), late=True).values()['deadline_misses'] == 1


def test_a_command_that_stays_out_for_two_periods_is_a_missed_deadline():
    """The node may have been busy with a new road: its steps are as short as ever."""
    times = StepTimes()
    for gap, misses in ((0.2, 0), (0.4, 0), (1.25, 1), (0.2, 1)):
        times.add(5.0, 5.0, 0.2, 0.0, gap=gap)
        assert times.values()['deadline_misses'] == misses
    assert times.values()['command_gap_ms_max'] == 1250.0


def test_a_step_that_outlasts_the_period_is_told_until_the_next_that_does_not():
    times = times_of((200.5, 200.5, 0.2, 0.0))
    assert times.warnings() == [
        'The last control step took 200.5 ms of the 200.0 ms until the next.'
    ]
    times.add(200.0, 200.0, 0.2, 0.0)
    assert times.warnings() == []


@pytest.mark.parametrize(('delay', 'said'), [(0.0, 1), (0.04, 0), (0.06, 0)])
def test_a_delay_that_nobody_knows_of_is_told_with_its_value(delay, said):
    times = times_of(*[(5.0, 50.0, 0.2, delay)] * 9)
    assert times.warnings() == []
    times.add(5.0, 50.0, 0.2, delay)
    sentence = 'Commands leave 50 ms after their odometry: command_delay should be 0.050 s or more.'
    assert times.warnings() == [sentence] * said


def with_ages(ages, delay=0.0):
    return times_of(*[(5.0, float(ages[-1]) + 5.0, 0.2, delay)] * 10, ages=ages)


def test_how_late_odometry_comes_is_told_with_the_delay_to_set():
    values = with_ages([*range(1, 100), 200.0]).values()
    assert values['odometry_latency_ms_min'] == 1.0
    assert values['odometry_latency_ms_p50'] == 50.5
    assert values['odometry_latency_ms_p99'] == pytest.approx(100.01)
    assert values['command_delay_measured'] == pytest.approx(0.205)


def test_a_clock_that_is_behind_or_ahead_is_told_apart_from_a_delay_that_varies():
    said = 'Odometry is 150 ms old or more when it comes: the clock of the robot is behind, or the'
    assert any(each.startswith(said) for each in with_ages([150.0, 160.0]).warnings())
    assert not any('clock' in each for each in with_ages([1.0, 150.0, 160.0]).warnings())
    assert with_ages([150.0, 160.0], delay=0.15).warnings() == []
    said = ['Odometry comes up to 50 ms before its time: the clock of the robot is ahead.']
    assert with_ages([-50.0, -40.0]).warnings() == said
    assert with_ages([-20.0, 0.0]).warnings() == []
    assert with_ages([-50.0]).values()['command_delay_measured'] == 0.0
