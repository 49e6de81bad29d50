"""Odometry that contradicts itself: the robot stops, says why, and does not go on too soon."""

import math

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from live import MS, ZERO
from nav_msgs.msg import Odometry
from rclpy.node import Node

PERIOD = 200 * MS
ACCELERATION = 100.0
"""Limit of the wheels in these tests [rad/s^2]: a stop takes half a second."""
LIMITED = {'robot.max_wheel_acceleration': ACCELERATION, 'final_time': 15.0}
FAST = 0.9


@pytest.fixture
def driving(start_node, record, client):
    """Start a node and its recorder, and drive until it is on its way: `driving(parameters)`.

    What it returns ends both and replays the bag.
    """

    def start(parameters=None):
        recording = record()
        guidance = start_node('guidance_node', {'recorder_timeout': 60.0, **(parameters or {})})
        client.connect()
        client.drive()
        client.until(lambda: client.commands and client.commands[-1][0] > FAST)

        def end():
            client.park()
            guidance.end()
            assert 'Traceback' not in guidance.stderr
            outcome = recording.replayed()
            assert outcome.stops > 0
            return outcome

        return end

    return start


@pytest.fixture
def repeat(client):
    """Do something at a period [s], until what this returns is called: `repeat(period, do)`."""

    def start(period, do):
        timer = client.node.create_timer(period, do)
        return lambda: client.node.destroy_timer(timer)

    return start


def switches(commands):
    """Number of times that a robot begins to move, or to stand."""
    return int(np.abs(np.diff([command != ZERO for command in commands])).sum())


def pause(client, seconds):
    """Let time pass, of the kind that the robot drives by."""
    end = client.now() + round(seconds * 1e9)
    client.until(lambda: client.now() > end)


def assert_wheels_can_follow(decisions):
    """No wheel changes from one command to the next by more than its limit allows in a period."""
    names = 'wheel_speed_right', 'wheel_speed_left'
    sent = [each for each in decisions if 'late' not in each]
    wheels = np.array([[float(each[name]) for name in names] for each in sent])
    assert np.abs(np.diff(wheels, axis=0)).max() <= ACCELERATION * PERIOD / 1e9 + 1e-6


@pytest.mark.parametrize('ahead', [0, 50 * MS], ids=['of now', 'of stamps that are newer'])
def test_a_ghost_of_the_robot_stops_it_until_the_ghost_is_gone(
    fault, driving, repeat, client, ros, ahead
):
    end = driving({'final_time': 15.0})
    ghost = Node('ghost', context=ros.node.context)
    odometry = ghost.create_publisher(Odometry, '/odom', 50)
    client.until(odometry.get_subscription_count)
    count, radii = len(client.decisions), []

    def haunt():
        client.odometry, mine = odometry, client.odometry
        client.send(client.now() + ahead, client.pose + np.array([0.0, 10.0, 0.0]))
        client.odometry = mine
        radii.append(math.hypot(*client.pose[:2]))

    vanish = repeat(0.02, haunt)
    named = '2 publishers on /odom: /ghost, /tester.'
    client.until_health(said=named, level=DiagnosticStatus.ERROR, odometry_publishers='2')
    jump = next(each for each in client.decisions[count:] if 'jumps by' in each['reason'])
    assert jump['reason'].endswith(named)
    fault.assert_decided(jump)
    commands = len(client.commands)
    pause(client, 2.0)
    assert set(client.commands[commands:]) == {ZERO}
    assert 9.0 < min(radii) <= max(radii) < 11.0
    vanish()
    client.until_driving()
    assert int(client.until_health(fallback_level='nominal')['odometry_refused']) > 10
    ghost.destroy_node()
    client.until_health(odometry_publishers='1', level=DiagnosticStatus.OK)
    end()


def leave_frame(message):
    message.header.frame_id = 'map'


def spoil(message):
    message.pose.pose.position.x = math.nan


def jump(message):
    message.pose.pose.position.y += 5.0


@pytest.mark.parametrize('harm', [leave_frame, spoil, jump])
def test_good_and_bad_odometry_in_turn_is_one_stop_within_the_limit(
    fault, driving, repeat, client, make_odometry, harm
):
    end = driving(LIMITED)
    count, decided = len(client.commands), len(client.decisions)

    def disturb():
        message = make_odometry(client.now(), client.pose)
        harm(message)
        client.odometry.publish(message)

    cease = repeat(0.02, disturb)
    pause(client, 2.0)
    cease()
    client.until_driving()
    # It brakes to rest, and goes on when the last disturbance is a control period ago.
    assert switches(client.commands[count - 1 :]) == 2
    braked = [each for each in client.decisions[decided:] if each.get('braking') == 'true']
    assert float(braked[0]['wheel_speed_right']) > 0.0
    said = next(each for each in braked if 'Recovering: ' in each['reason'])
    fault.assert_decided(said)
    assert_wheels_can_follow(client.decisions)
    end()


def test_old_odometry_between_new_is_ignored(fault, start_driving, repeat, client):
    start_driving()
    count = len(client.decisions)
    for age in (30 * MS, 100_000 * MS):
        repeat(0.01, lambda age=age: client.send(client.now() - age, client.pose + 5.0))
    client.until(lambda: int(client.latest('odometry_out_of_order', '0')) > 20)
    assert client.latest('odometry_refused') == '0'
    assert not any(each['halted'] == 'true' for each in client.decisions[count:])
    client.until(lambda: client.decisions[-1]['reason'].startswith('The plan meets'))
    fault.assert_said('nominal', client.decisions[-1]['level'][0], client.decisions[-1]['reason'])


def test_a_robot_that_is_located_anew_stops_and_goes_on_from_there(fault, driving, client):
    end = driving()
    count = len(client.decisions)
    # Away from the nearer edge of the road.
    aside = -0.3 if client.pose[1] > -10.0 else 0.3
    client.pose = client.pose + np.array([0.0, aside, 0.0])
    reason = 'Odometry jumps by 0.3'
    client.until(lambda: any(reason in each['reason'] for each in client.decisions[count:]))
    halted = next(each for each in client.decisions[count:] if reason in each['reason'])
    fault.assert_decided(halted)
    client.until_driving()
    client.until(lambda: client.decisions[-1]['halted'] == 'false')
    stamps = [
        int(each['stamp'])
        for each in client.decisions[client.decisions.index(halted) :]
        if each['halted'] == 'false'
    ]
    assert stamps[0] - int(halted['stamp']) >= PERIOD
    end()


@pytest.mark.parametrize(
    ('offset', 'said'),
    [
        (-150 * MS, 'the clock of the robot is behind, or the transport is slow.'),
        (150 * MS, 'the clock of the robot is ahead.'),
    ],
)
def test_a_clock_that_is_off_is_told_with_the_delay(start_node, repeat, client, offset, said):
    start_node('guidance_node', {'goal.wait': False})
    client.connect()
    repeat(0.02, lambda: client.send(client.now() + offset))
    health = client.until_health(said=said)
    late = [float(health[f'odometry_latency_ms_{each}']) for each in ('min', 'p50', 'p99')]
    assert late == sorted(late)
    assert (late[0] > 150.0) if offset < 0 else (-150.0 <= late[0] < -20.0)
    proposed = float(health['command_delay_measured'])
    assert (proposed > 0.15) if offset < 0 else (proposed < 0.13)
    assert ('command_delay should be' in health['said']) == (offset < 0)
