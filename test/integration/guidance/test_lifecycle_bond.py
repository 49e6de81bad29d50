"""The heartbeat for Nav2's lifecycle manager: there while the node is active, and its end said."""

import pytest

pytestmark = pytest.mark.integration


def test_it_beats_while_the_node_is_active(interfaces, start_node, client):
    interfaces('bond')
    from bond.msg import Status

    beats = []
    client.node.create_subscription(Status, 'bond', beats.append, 100)
    running = start_node(parameters={'autostart': False})
    assert client.change_state('configure')
    client.until(lambda: client.node.count_publishers('bond'))
    assert client.change_state('activate')
    client.until(lambda: len(beats) > 3)
    assert {(each.id, each.active) for each in beats} == {('guidance', True)}
    assert client.change_state('deactivate')
    client.until(lambda: not beats[-1].active)
    first = beats[-1].instance_id
    assert client.change_state('activate')
    client.until(lambda: beats[-1].active)
    assert beats[-1].instance_id != first
    running.end()
    client.until(lambda: not beats[-1].active)
