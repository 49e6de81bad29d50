"""Reading what is there, and saying what is not."""

import pytest
from bag_messages import EVENT, TWIST, make, parameter_event, raw, time, twist
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from cmpsp_ros.bags import Bag, BagError, BagWriter
from cmpsp_ros.bags.definitions import jazzy


def moving(speed):
    return raw(twist(speed, -speed))


@pytest.fixture
def path(tmp_path):
    path = tmp_path / 'bag'
    with BagWriter(path) as bag:
        bag.topic('/cmd_vel', TWIST)
        bag.topic('/silent', TWIST)
        for stamp in (10, 20, 15):
            bag.write('/cmd_vel', stamp, moving(stamp / 3))
        bag.set_parameters('/guidance', {'goal.tolerance': 0.1})
    return path


def test_content(path):
    with Bag(path) as bag:
        assert {name: (each.msgtype, each.count) for name, each in bag.topics.items()} == {
            '/cmd_vel': (TWIST, 3),
            '/silent': (TWIST, 0),
        }
        assert (bag.start, bag.end) == (10, 20)
        assert bag.parameters == {'/guidance': {'goal.tolerance': 0.1}}
        assert bag.version
        messages = list(bag.messages('/cmd_vel'))
        assert [stamp for stamp, _ in messages] == [10, 15, 20]
        assert [each.linear.x for _, each in messages] == [10 / 3, 15 / 3, 20 / 3]
        stamp, raw = next(bag.raw('/cmd_vel'))
        assert (stamp, raw) == (10, moving(10 / 3))
        assert list(bag.messages('/silent')) == []


def test_missing_topic_names_what_is_there(path):
    with Bag(path) as bag:
        for read in (bag.raw, bag.messages):
            with pytest.raises(BagError, match=r'no topic /odom; there is /cmd_vel, /silent'):
                next(read('/odom'))


def test_closed(path):
    bag = Bag(path)
    bag.close()
    bag.close()
    with pytest.raises(BagError, match='is closed'):
        next(bag.raw('/cmd_vel'))


def test_empty_bag(tmp_path):
    BagWriter(tmp_path / 'empty').close()
    with Bag(tmp_path / 'empty') as bag:
        assert (bag.topics, bag.start, bag.end, bag.parameters) == ({}, 0, 0, {})


@pytest.mark.parametrize(
    ('changed_at', 'decided_at', 'known'),
    [
        (5, None, {'a': 1.0, 'b': 2.0}),
        (15, None, {'a': 1.0}),
        (15, 18, {'a': 1.0}),
        (15, 30, {'a': 1.0, 'b': 2.0}),
    ],
)
def test_what_was_changed_before_the_parameters_came_is_unknown_if_used(
    tmp_path, changed_at, decided_at, known
):
    everything = parameter_event('/guidance', {'a': 1.0, 'b': 2.0}).changed_parameters
    changed = [each for each in everything if each.name == 'b']
    told = make(EVENT, time(changed_at), '/guidance', everything, changed, [])
    with BagWriter(tmp_path / 'bag') as bag:
        bag.topic('/cmd_vel', TWIST)
        bag.topic('/guidance/parameters', EVENT)
        bag.write('/cmd_vel', 10, moving(1.0))
        if decided_at:
            bag.topic('/guidance/decision', TWIST)
            bag.write('/guidance/decision', decided_at, moving(1.0))
        bag.write('/guidance/parameters', 20, raw(told))
    with Bag(tmp_path / 'bag') as bag:
        assert bag.parameters == {'/guidance': known}


def test_single_file(path):
    with Bag(next(path.glob('*.mcap'))) as bag:
        assert len(list(bag.raw('/cmd_vel'))) == 3


def test_bag_of_another_program(tmp_path):
    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg('float64 value\n', 'my_msgs/msg/Own'))
    message = store.types['my_msgs/msg/Own'](1 / 3)
    with Writer(tmp_path / 'a', version=8, storage_plugin=StoragePlugin.MCAP) as writer:
        connection = writer.add_connection('/own', 'my_msgs/msg/Own', typestore=store)
        writer.write(connection, 3, store.serialize_cdr(message, 'my_msgs/msg/Own'))
    with Bag(tmp_path / 'a') as bag:
        ((stamp, read),) = bag.messages('/own')
        assert (stamp, read.value) == (3, 1 / 3)
        assert (bag.parameters, bag.version) == ({}, '')


def test_sqlite3(tmp_path):
    with Writer(tmp_path / 'a', version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection('/cmd_vel', TWIST, typestore=jazzy())
        writer.write(connection, 3, moving(1.0))
    with Bag(tmp_path / 'a') as bag:
        assert [each.linear.x for _, each in bag.messages('/cmd_vel')] == [1.0]
