"""The table as parameters of a node; nothing here leaves the process."""

import pytest
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter

from cmpsp_ros.nodes.common.parameters import declare
from cmpsp_ros.parameters import TABLE, ParameterError

OBSTACLE = ['obstacles.names:=[a]', 'obstacles.a.center:=[1.0, 2.0]', 'obstacles.a.radius:=1']


@pytest.fixture
def make_node(monkeypatch, tmp_path):
    """A node from parameters as on the command line."""
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'OFF')
    monkeypatch.setenv('ROS_LOG_DIR', str(tmp_path))
    made = []

    def make(*given, **more):
        context = Context()
        context.init(args=['--ros-args', *(flag for each in given for flag in ('-p', each))])
        made.append((context, Node('probe', context=context, **more)))
        return made[-1][1]

    yield make
    for context, node in made:
        node.destroy_node()
        context.try_shutdown()


@pytest.mark.parametrize('automatic', [False, True])
@pytest.mark.parametrize('which', ['guidance', 'sim'])
def test_a_node_declares_what_it_uses_with_words_and_units(make_node, which, automatic):
    node = make_node(*OBSTACLE, automatically_declare_parameters_from_overrides=automatic)
    values = declare(node, which)
    for key, row in TABLE.keys(values):
        if which in row.nodes:
            assert node.get_parameter(key).value == values[key]
            descriptor = node.describe_parameter(key)
            assert descriptor.description == row.description
            assert row.wanted in descriptor.additional_constraints
            assert descriptor.dynamic_typing
            assert descriptor.read_only == (not row.reconfigurable)
            for bounds in (*descriptor.floating_point_range, *descriptor.integer_range):
                assert bounds.from_value == max(row.range.low, -1e9)
                assert bounds.to_value == min(row.range.high, 1e9)
        else:
            assert not node.has_parameter(key)


def test_what_is_given_comes_in_the_type_of_the_table(make_node):
    node = make_node(*OBSTACLE, 'final_time:=12', 'road.center:=[1, 2]')
    values = declare(node, 'guidance')
    assert values['road.center'] == [1.0, 2.0]
    assert node.get_parameter('final_time').type_ == Parameter.Type.DOUBLE
    assert node.get_parameter('road.center').type_ == Parameter.Type.DOUBLE_ARRAY
    assert node.get_parameter('obstacles.a.radius').type_ == Parameter.Type.DOUBLE


def test_an_empty_list_is_a_list_of_strings(make_node):
    node = make_node('obstacles.names:=[]')
    assert declare(node, 'sim')['obstacles.names'] == []
    assert node.get_parameter('obstacles.names').type_ == Parameter.Type.STRING_ARRAY


def test_what_is_misspelt_or_wrong_is_named_and_nothing_declared(make_node):
    node = make_node('final_tme:=12.0', 'solver.qp:=3', 'initial_pose:=[1.0]')
    with pytest.raises(ParameterError) as caught:
        declare(node, 'guidance')
    assert [problem.where for problem in caught.value.problems] == [
        'solver.qp', 'initial_pose', 'final_tme',
    ]  # fmt: skip
    assert 'did you mean final_time?' in str(caught.value)
    assert not node.has_parameter('final_time')
