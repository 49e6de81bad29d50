"""Parameters of nodes, as a bag has them."""

import signal
import sys

import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from recorder_process import flushing

from cmpsp_ros.bags import Bag
from cmpsp_ros.nodes import MODULES

pytestmark = pytest.mark.integration

KEY = 'noise.position_stddev'


@pytest.fixture
def start_sim(spawn):
    """Start a simulator, with a value of the parameter."""
    command = [sys.executable, '-m', MODULES['sim_node'], '--ros-args', '-p']
    return lambda value: spawn([*command, f'{KEY}:={value}'])


@pytest.fixture
def change(ros):
    """Change the parameter of the simulator."""

    def change(value):
        wanted = [Parameter(KEY, value=value).to_parameter_msg()]
        request = SetParameters.Request(parameters=wanted)
        assert ros.call(SetParameters, '/sim/set_parameters', request).results[0].successful

    return change


def changes(bag):
    return [
        each.value.double_value
        for _, event in bag.messages('/parameter_events')
        for each in event.changed_parameters
        if event.node == '/sim'
    ]


def test_they_are_those_before_the_first_recorded_change(record, ros, bag, start_sim, change):
    start_sim(0.125)
    change(0.25)
    # What topics are chosen does not matter.
    recorder = record('topics:=[/odom]')
    counts = flushing(ros)
    ros.spin_until(lambda: counts().get('/sim/parameters') == 1)
    change(0.5)
    ros.spin_until(lambda: counts().get('/sim/parameters') == 2)
    recorder.signal(signal.SIGINT)
    assert recorder.wait() == 0
    with Bag(bag) as recorded:
        assert recorded.parameters['/sim'][KEY] == 0.25
        assert changes(recorded) == [0.5]
        assert recorded.restarts == {}


def test_a_node_that_is_started_anew_has_its_new_parameters_kept(record, ros, bag, start_sim):
    recorder = record()
    counts, begun = flushing(ros), []
    for number, value in enumerate((0.125, 0.25), 1):
        begun.append(ros.node.get_clock().now().nanoseconds)
        simulator = start_sim(value)
        ros.spin_until(lambda number=number: counts().get('/sim/parameters') == number)
        simulator.signal(signal.SIGINT)
        assert simulator.wait() == 0
    recorder.signal(signal.SIGINT)
    assert recorder.wait() == 0, recorder.stderr
    with Bag(bag) as recorded:
        assert recorded.parameters['/sim'][KEY] == 0.125
        ((since, values),) = recorded.restarts['/sim']
        assert values[KEY] == 0.25
        assert begun[0] < begun[1] < since
