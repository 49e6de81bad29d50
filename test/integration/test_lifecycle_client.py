"""The observer of a run, alone on its domain."""

import signal

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from cmpsp_ros.nodes import LifecycleClient


def test_a_node_that_does_not_answer_may_be_compiling(ros_domain):
    with (
        LifecycleClient(ros_domain) as observer,
        pytest.raises(TimeoutError, match='within 1 s; if it was compiling, run `cmpsp warmup`'),
    ):
        observer.configure(1.0)


@pytest.fixture
def interruptible():
    """Answer SIGINT as Python does; parallel tests ignore it."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


def test_an_interruption_waits_until_a_message_is_heard(ros, ros_domain, interruptible):
    """Inside of rclpy it would be lost, or become a RuntimeError."""
    heard = []

    def hear(namespace, seen):
        signal.raise_signal(signal.SIGINT)
        heard.append((namespace, seen.decisions))

    with LifecycleClient(ros_domain) as observer:
        observer.on_decision = hear
        publisher = ros.node.create_publisher(DiagnosticArray, '/guidance/decision', 10)
        decision = DiagnosticArray(status=[DiagnosticStatus()])
        with pytest.raises(KeyboardInterrupt):
            # It is told until it is heard: the first ones may be lost.
            observer.wait_until(lambda: publisher.publish(decision) is not None, 20.0)
    assert heard == [('', 1)]
