"""Parameters of other nodes, as the recorder finds them."""

from __future__ import annotations

import signal
import time
from functools import partial

import pytest
from rclpy.node import Node
from rclpy.parameter import Parameter
from recorder_process import heard
from std_msgs.msg import String

from cmpsp_ros.bags.reader import Bag

pytestmark = pytest.mark.integration


def test_parameters_are_those_of_the_beginning(record, ros, bag):
    ros.node.declare_parameter('gain', 1.5)
    recorder = record()
    publisher = ros.node.create_publisher(String, 'said', 10)
    clients = []

    def answered():
        # The recorder's client comes, and goes when it has its answer.
        clients.append(ros.node.count_clients('/tester/get_parameters'))
        return 1 in clients and clients[-1] == 0

    ros.spin_until(answered)
    ros.spin_until(heard(publisher))
    ros.spin_until(heard(ros.node._parameter_event_publisher))
    ros.node.declare_parameter('late', 2.5)
    ros.node.set_parameters([Parameter('gain', value=9.0), Parameter('late', value=9.0)])
    recorder.signal(signal.SIGINT)
    ros.spin_until(lambda: recorder.process.poll() is not None)
    with Bag(bag) as recorded:
        tester = recorded.parameters['/tester']
        assert (tester['gain'], tester['late']) == (1.5, 2.5)
        changed = [
            (each.name, each.value.double_value)
            for _, event in recorded.messages('/parameter_events')
            for each in event.changed_parameters
        ]
        assert ('gain', 9.0) in changed


def test_a_node_that_is_started_anew_has_its_new_parameters_kept(record, ros, bag):
    recorder = record()
    for gain in (1.5, 1.5, 2.5):
        node = Node('other', context=ros.node.context)
        ros.executor.add_node(node)
        node.declare_parameter('gain', gain)
        count = partial(ros.node.count_clients, '/other/get_parameters')
        # The recorder's client comes, and goes when it has its answer.
        ros.spin_until(count)
        ros.spin_until(lambda count=count: count() == 0)
        since = ros.node.get_clock().now().nanoseconds
        ros.executor.remove_node(node)
        node.destroy_node()
        present = ros.node.get_node_names
        ros.spin_until(lambda present=present: 'other' not in present())
        # The recorder has to see that it is gone.
        end = time.monotonic() + 0.5
        ros.spin_until(lambda end=end: time.monotonic() > end)
    recorder.signal(signal.SIGINT)
    assert recorder.wait() == 0, recorder.stderr
    with Bag(bag) as recorded:
        assert recorded.parameters['/other']['gain'] == 1.5
        ((begun, values),) = recorded.restarts['/other']
        assert values['gain'] == 2.5
        assert since - 5_000_000_000 < begun < since
