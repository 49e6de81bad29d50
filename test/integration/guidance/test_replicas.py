"""Guidance and simulator together: one pair in lockstep, and two on one domain."""

import pytest
from nav_msgs.msg import Odometry
from rclpy.duration import Duration
from rclpy.time import Time
from rosgraph_msgs.msg import Clock

pytestmark = pytest.mark.integration

LOCKSTEP = {'lockstep': True, 'publish_clock': True}


def finished(client):
    return client.decisions and client.decisions[-1]['finished'] == 'true'


def test_two_pairs_on_one_domain_arrive_and_do_not_hear_each_other(start_node, make_client):
    goals = {'/r1': (10.0, 0.0), '/r2': (9.5, 1.0)}
    starts = {'/r1': (0.0, -9.25, 0.0), '/r2': (0.5, -10.5, 0.1)}
    clients, pairs = {}, []
    for prefix, goal in goals.items():
        # Time of its own for each: on one /clock two simulators would contradict each other.
        names = ['-r', f'__ns:={prefix}', '-r', f'/clock:={prefix}/clock']
        place = {'initial_pose': list(starts[prefix]), 'goal.position': list(goal)}
        pairs.append(start_node('sim_node', {**LOCKSTEP, **place}, *names))
        guided = {'use_sim_time': True, 'autostart': False, **place}
        pairs.append(start_node('guidance_node', guided, *names))
        clients[prefix] = make_client(prefix=prefix)
    one, two = clients.values()
    truth = {prefix: [] for prefix in goals}
    for prefix, client in clients.items():
        client.node.create_subscription(Odometry, f'{prefix}/sim/truth', truth[prefix].append, 2000)
        assert client.change_state('configure')
    for client in (one, two):
        client.until(lambda client=client: int(client.latest('command_subscribers', '0')) >= 2)
    node = one.node

    def ends(infos):
        return {(each.node_namespace, each.node_name) for each in infos}

    sources, listeners = node.get_publishers_info_by_topic, node.get_subscriptions_info_by_topic
    for prefix in goals:
        one.until(lambda prefix=prefix: truth[prefix])
        one.until(
            lambda prefix=prefix: ends(sources(f'{prefix}/cmd_vel')) == {(prefix, 'guidance')}
        )
        one.until(lambda prefix=prefix: ends(listeners(f'{prefix}/odom')) == {(prefix, 'guidance')})
    for client in (one, two):
        assert client.change_state('activate')
    one.until(lambda: finished(one) and finished(two))
    for prefix, client in clients.items():
        # Who is done first goes on to say so.
        assert [each['finished'] for each in client.decisions[:51]] == ['false'] * 50 + ['true']
        assert float(client.decisions[50]['terminal_error']) < 1e-6
        path = [each.pose.pose.position for each in truth[prefix]]
        assert (path[0].x, path[0].y) == starts[prefix][:2]
    for process in pairs:
        assert process.process.poll() is None
        assert 'Traceback' not in process.stderr
    assert not node.count_publishers('/clock')
    assert not node.count_publishers('/cmd_vel')


def test_a_node_that_uses_simulated_time_lives_before_there_is_any(fault, start_node, client):
    start_node('guidance_node', {'use_sim_time': True})
    health = client.until_health(state='active', said='Waiting for odometry')
    # Heard late it says as well that the clock stands still.
    assert health['said'].startswith('Waiting for odometry.')
    fault.assert_said('—', health['level'][0], 'Waiting for odometry.')
    client.connect()
    clock = client.node.create_publisher(Clock, '/clock', 10)
    client.until(clock.get_subscription_count)
    tick = Clock(clock=Time(seconds=5).to_msg())
    clock.publish(tick)
    clock.wait_for_all_acked(Duration(seconds=60.0))
    client.send(5_000_000_000)
    client.until(lambda: client.commands)
    assert client.commands[0][0] > 0.5
