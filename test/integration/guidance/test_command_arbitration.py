"""Two guidance nodes for one robot, and others that command; see doc/reference/faults.md."""

import signal
import time

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import Twist

from cmpsp_ros.nodes.common.topics import GUIDED_BY
from cmpsp_ros.nodes.guidance.command_arbitration import CommandArbiter

ZERO = (0.0, 0.0)
# Nearly half way round takes long enough for another node to start on a busy machine.
FAR = {'final_time': 30.0, 'goal.position': [1.74, 9.85]}
# The same robot by another node of the package, and a robot of its own elsewhere.
SECOND = ('-r', '__ns:=/spare', '-r', 'odom:=/odom', '-r', 'cmd_vel:=/cmd_vel')


def as_second(make_client):
    """A client that hears what the second node says; its robot is the first one's."""
    return make_client(prefix='/spare')


def test_a_second_guidance_node_stays_inactive(
    fault, start_node, start_driving, client, make_client
):
    start_driving(FAR)
    second = as_second(make_client)
    start_node('guidance_node', {}, *SECOND)
    health = second.until_health(said='Another node guides this robot: /guidance (')
    fault.assert_told(health)
    # On a very slow machine it was active for as long as it had not heard of the first.
    second.until_health(state='inactive')
    count = len(second.decisions)
    # Nor is it activated by hand, while the first goes on.
    assert not second.change_state('activate')
    assert len(second.decisions) == count
    client.until_driving()
    client.until_health(state='active', fallback_level='nominal', said='Others publish on /cmd_vel')
    # Once the first has been deactivated, the second may take over: when it is told to.
    assert client.change_state('deactivate')
    client.until(lambda: client.decisions[-1]['reason'].endswith('was deactivated.'))
    fault.assert_decided(client.decisions[-1])
    client.until(lambda: second.change_state('activate'))
    second.until_health(state='active', fallback_level='nominal')
    assert second.decisions[count]['step'] == '0'


def test_of_two_that_began_together_the_later_gives_way(fault, start_driving, client):
    """Both are active before either has heard the other; then each hears when the other began."""
    start_driving()
    rival = GUIDED_BY.publish_on(client.node)
    client.until(rival.get_subscription_count)
    later = str(time.time_ns() + 10**18)
    rival.publish(KeyValue(key='/rival (elsewhere:1)', value=later))
    client.until_driving()
    client.until_health(state='active', fallback_level='nominal')
    rival.publish(KeyValue(key='/rival (elsewhere:1)', value='1'))
    client.until_health(state='inactive', said='robot: /rival (elsewhere:1).')
    client.until(lambda: client.commands[-1] == ZERO)
    client.until(lambda: client.decisions[-1]['fallback_level'] == 'stop')
    fault.assert_decided(client.decisions[-1])


def test_nodes_of_one_name_host_and_process_id_are_told_apart(ros, monkeypatch):
    """As in two containers that share the network of their host."""
    monkeypatch.setattr('os.getpid', lambda: 1)
    gave_way = []
    first, second = (
        CommandArbiter(ros.node, lambda rival, each=each: gave_way.append(each))
        for each in ('first', 'second')
    )
    first.begin()
    ros.spin_until(lambda: second.guiding)
    second.begin()
    ros.spin_until(lambda: gave_way)
    assert set(gave_way) == {'second'}
    for each in (first, second):
        each.close()


def test_a_node_that_was_killed_has_a_successor(fault, start_node, start_driving, client):
    """A dead process that the graph still shows does not keep the next one from guiding."""
    first = start_driving()
    first.signal(signal.SIGKILL)
    assert first.wait() == -signal.SIGKILL
    # A robot stops by itself when commands stay out.
    client.park()
    client.commands.clear()
    count = len(client.decisions)
    start_node()
    client.until_health(state='active', said='Waiting')
    client.connect()
    client.drive()
    client.until(lambda: len(client.decisions) > count)
    assert client.decisions[count]['step'] == '0'
    client.until_driving()
    client.until(lambda: client.decisions[-1]['reason'] == 'The plan meets every constraint.')
    fault.assert_decided(client.decisions[-1])


def test_another_source_of_commands_is_told(fault, start_driving, client):
    start_driving()
    client.until_health(level=DiagnosticStatus.OK, fallback_level='nominal')
    joystick = client.node.create_publisher(Twist, '/cmd_vel', 1)
    health = client.until_health(said='Others publish on /cmd_vel, too: /tester.')
    fault.assert_told(health)
    assert health['fallback_level'] == 'nominal'
    client.node.destroy_publisher(joystick)
    client.until_health(level=DiagnosticStatus.OK, fallback_level='nominal')
