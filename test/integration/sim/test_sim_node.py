"""The simulator as a process over DDS, driven by a small client."""

import math
import signal
import time
from itertools import pairwise

import numpy as np
import pytest
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import DescribeParameters, GetParameters, SetParameters
from sim_client import MS, PERIOD_NS, Client, place, speed, stamp, twist

from cmpsp_ros.robots import DifferentialDrive


def test_odometry_lies_on_an_exact_grid_in_the_time_of_the_system(simulate, ros):
    before = time.time_ns()
    simulate()
    client = Client(ros)
    client.connect()
    first = stamp(client.odometry[-1])
    client.until(lambda: stamp(client.odometry[-1]) >= first + 100 * PERIOD_NS)
    stamps = [stamp(message) for message in client.odometry]
    assert all((late - early) % PERIOD_NS == 0 and late > early for early, late in pairwise(stamps))
    # In the time of the system, which passes neither faster nor slower.
    assert before < stamps[0]
    assert stamps[-1] < time.time_ns()
    assert client.odometry[-1].header.frame_id == 'odom'
    assert client.odometry[-1].child_frame_id == 'base_link'
    assert np.allclose(place(client.odometry[-1]), [0.0, -9.25, 0.0], atol=0.0)
    assert not client.clocks


def test_the_clock_of_the_robot_may_be_ahead(simulate, ros):
    simulate({'clock_offset': 100.0})
    client = Client(ros)
    client.connect()
    ahead = stamp(client.odometry[-1]) - time.time_ns()
    assert 90_000 * MS < ahead < 100_000 * MS


def test_a_twist_that_is_no_number_is_refused_and_the_last_one_expires(simulate, ros):
    running = simulate({'cmd_vel_timeout': 1.0})
    client = Client(ros)
    client.connect()
    client.command_until(twist(0.2), lambda: speed(client.odometry[-1]) > 0.19)
    client.command_until(twist(math.nan), lambda: 'cmd_vel refused: twist (nan' in running.stderr)
    client.until(lambda: speed(client.truth[-1]) == 0.0)
    grid = stamp(client.odometry[0]) % PERIOD_NS
    # Between two instants of odometry the truth is told at changes only.
    changes = [message for message in client.truth if stamp(message) % PERIOD_NS != grid]
    *_, last_valid, stop = changes
    assert speed(last_valid) == pytest.approx(0.2)
    assert speed(stop) == 0.0
    assert stamp(stop) - stamp(last_valid) == 1000 * MS


def test_the_path_is_drawn_again_from_the_truth_alone(simulate, ros):
    simulate({'cmd_vel_timeout': 0.1})
    client = Client(ros)
    client.connect()
    client.command_until(twist(0.3, 1.0), lambda: len([t for t in client.truth if speed(t)]) > 20)
    client.command_until(twist(9.0, -3.0), lambda: speed(client.truth[-1]) > 1.0)
    client.until(lambda: speed(client.truth[-1]) == 0.0)
    truth, robot = client.truth, DifferentialDrive()
    for early, late in pairwise(truth):
        speeds = robot.wheel_speeds(
            np.array([early.twist.twist.linear.x, early.twist.twist.angular.z])
        )
        assert np.abs(speeds).max() <= 51.0 * (1.0 + 1e-12)
        duration = np.array([(stamp(late) - stamp(early)) / 1e9])
        end = robot.roll_out(place(early), speeds[None], duration)[1]
        assert np.allclose(end, place(late), atol=1e-9)
    wheels = [max(map(abs, message.velocity)) for message in client.wheels]
    assert max(wheels) == 51.0
    assert client.wheels[-1].name == ['wheel_right_joint', 'wheel_left_joint']


def test_a_reset_leads_back_to_the_initial_pose_while_time_goes_on(simulate, ros):
    simulate()
    client = Client(ros)
    client.connect()
    client.command_until(twist(1.0), lambda: place(client.odometry[-1])[0] > 0.1)
    before = stamp(client.odometry[-1])
    assert client.reset()
    client.until(lambda: place(client.odometry[-1])[0] == 0.0)
    assert stamp(client.odometry[-1]) > before
    assert speed(client.odometry[-1]) == 0.0


def test_simulated_time_begins_at_zero_and_goes_before_odometry(simulate, ros):
    simulate({'publish_clock': 'true', 'real_time_factor': 4.0, 'noise.position_stddev': 0.01})
    client = Client(ros)
    client.connect()
    client.until(lambda: len(client.odometry) > 100 and len(client.clocks) > 100)
    stamps = [stamp(message) for message in client.odometry]
    assert all(each % PERIOD_NS == 0 for each in stamps)
    assert stamps[0] < 20_000 * MS
    assert set(client.clocks) & set(stamps)
    covariance = client.odometry[-1].pose.covariance
    assert covariance[0] == covariance[7] == pytest.approx(1e-4)
    assert np.std([place(message)[0] for message in client.odometry]) == pytest.approx(0.01, 0.5)


@pytest.mark.parametrize(
    ('parameters', 'said'),
    [
        ({'odom_rat': 50.0}, ['odom_rat:', 'did you mean odom_rate?']),
        ({'initial_pose': '[0.0, 0.0, 0.0]'}, ['initial_pose:', 'road edge']),
    ],
)
def test_what_cannot_be_simulated_ends_with_its_key_and_nothing_published(
    simulate, parameters, said
):
    running = simulate(parameters)
    assert running.wait() == 1
    assert 'Traceback' not in running.stderr
    for words in said:
        assert words in running.stderr


def test_integers_for_doubles_empty_lists_and_keys_of_the_guidance_are_taken(
    simulate, ros, tmp_path
):
    file = tmp_path / 'all.yaml'
    file.write_text(
        '/**:\n  ros__parameters:\n    odom_rate: 25\n    obstacles: {names: []}\n'
        '    weights: {road_center: 15}\n    use_sim_time: false\n'
    )
    simulate(None, '--params-file', str(file))
    client = Client(ros)
    client.connect()
    names = ['odom_rate', 'obstacles.names']
    got = ros.call(GetParameters, '/sim/get_parameters', GetParameters.Request(names=names))
    assert got.values[0].type == 3  # a double
    assert got.values[0].double_value == 25.0
    assert got.values[1].type == 9  # strings
    request = DescribeParameters.Request(names=names)
    described = ros.call(DescribeParameters, '/sim/describe_parameters', request)
    assert described.descriptors[0].description.startswith('Odometry messages per second')
    assert 'a number > 0' in described.descriptors[0].additional_constraints


def test_parameters_change_live_as_one_valid_set_or_not_at_all(simulate, ros):
    simulate()
    client = Client(ros)
    client.connect()

    def change(key, value):
        parameter = Parameter(name=key, value=ParameterValue(type=3, double_value=value))
        request = SetParameters.Request(parameters=[parameter])
        return ros.call(SetParameters, '/sim/set_parameters', request).results[0]

    refused = change('cmd_vel_timeout', -1.0)
    assert not refused.successful
    # By its descriptor, which ROS looks at first.
    assert 'cmd_vel_timeout out of range' in refused.reason
    assert 'value: -1.0' in refused.reason
    fixed = change('odom_rate', 10.0)
    assert not fixed.successful
    assert 'read-only' in fixed.reason
    assert change('noise.position_stddev', 0.01).successful
    client.until(lambda: place(client.odometry[-1])[0] != 0.0)
    assert change('noise.position_stddev', 0.0).successful
    client.until(lambda: place(client.odometry[-1])[0] == 0.0)
    assert change('cmd_vel_timeout', 0.0).successful
    client.command_until(twist(0.1), lambda: speed(client.odometry[-1]) > 0.0)
    last = stamp(client.odometry[-1])
    client.until(lambda: stamp(client.odometry[-1]) > last + 700 * MS)
    assert speed(client.odometry[-1]) > 0.0


@pytest.mark.parametrize(
    ('number', 'times', 'lockstep'),
    [(signal.SIGINT, 1, 'true'), (signal.SIGINT, 2, 'false'), (signal.SIGTERM, 2, 'true')],
)
def test_a_signal_ends_it_in_good_order(simulate, ros, number, times, lockstep):
    running = simulate({'lockstep': lockstep})
    client = Client(ros)
    client.connect()
    for _ in range(times):
        running.signal(number)
    assert running.wait() == 0
    assert 'Traceback' not in running.stderr
