"""Faults that only the node's own process can be given; compared with doc/reference/faults.md."""

import secrets

import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor

from cmpsp_ros.guidance import GuidanceLaw
from cmpsp_ros.guidance.planning import Planner
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.nodes.guidance.node import GuidanceNode
from cmpsp_ros.parameters import config_directory

pytestmark = pytest.mark.integration


@pytest.fixture
def node(ros_domain):
    """The guidance node in this process, spun by hand."""
    course = ['--params-file', str(config_directory() / 'case3.yaml'), '-p', 'autostart:=true']
    rclpy.init(args=['--ros-args', *course, '-p', 'odom_timeout:=60.0'], domain_id=ros_domain)
    made = GuidanceNode()
    executor = SingleThreadedExecutor()
    executor.add_node(made)
    yield executor
    made.stop()
    executor.shutdown()
    made.destroy_node()
    rclpy.try_shutdown()


@pytest.fixture
def both(node, client):
    """Let the node and its client work; the node is active."""

    def both():
        node.spin_once(timeout_sec=0.01)
        client.ros.executor.spin_once(timeout_sec=0.01)

    return both


def test_a_kernel_compiled_while_active_is_an_error(fault, both, client, wait_until):
    wait_until(lambda: client.latest('state') == 'active', step=both)
    # No cache has it.
    number = secrets.randbits(60)
    allocation_free(lambda x: x + number)(1)
    wait_until(lambda: 'compiler' in client.latest('said'), step=both)
    fault.assert_told(client.health[-1])


def test_an_exception_in_the_law_stops_the_robot(
    fault, both, client, make_odometry, wait_until, monkeypatch
):
    def decide(stamp):
        count = len(client.decisions)
        client.odometry.publish(make_odometry(stamp, (0.0, -9.25, 0.0)))
        wait_until(lambda: len(client.decisions) > count, step=both)
        wait_until(lambda: len(client.commands) > count, step=both)
        return client.decisions[-1], client.commands[-1]

    wait_until(
        lambda: client.odometry.get_subscription_count() and client.latest('state') == 'active',
        step=both,
    )
    wait_until(lambda: int(client.latest('command_subscribers')) > 0, step=both)
    begin = client.now()
    _, command = decide(begin)
    assert command[0] > 0.5
    with monkeypatch.context() as patch:
        patch.setattr(Planner, 'improve', lambda *_, **__: 1 / 0)
        decision, command = decide(begin + 200_000_000)
    assert command == (0.0, 0.0)
    fault.assert_decided(decision)
    assert decision['reason'] == 'The guidance law failed: ZeroDivisionError: division by zero'
    decision, command = decide(begin + 400_000_000)
    assert decision['fallback_level'] == 'nominal'
    assert command[0] > 0.5
    with monkeypatch.context() as patch:
        patch.setattr(GuidanceLaw, '_search', lambda *_: 1 / 0)
        decide(begin + 600_000_000)
        wait_until(lambda: client.decisions[-1]['fallback_level'] == 'stop', step=both)
    wanted = 'The search of the grid failed: ZeroDivisionError: division by zero'
    assert client.decisions[-1]['reason'] == wanted
    wait_until(lambda: client.commands[-1] == (0.0, 0.0), step=both)
