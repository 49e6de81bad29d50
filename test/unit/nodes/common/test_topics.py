"""The table of topics is what the nodes really open."""

import gc
import sys

import pytest
import rclpy
from nav_msgs.msg import Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from cmpsp_ros.bags import UnknownTypeError
from cmpsp_ros.nodes.common.topic import message_class
from cmpsp_ros.nodes.common.topics import TOPICS
from cmpsp_ros.nodes.guidance.node import GuidanceNode
from cmpsp_ros.nodes.recording.options import own_topics
from cmpsp_ros.nodes.recording.qos import for_bag, offering
from cmpsp_ros.nodes.recording.recorder import Recorder
from cmpsp_ros.nodes.sim.node import SimNode

OF_ROS = {'/rosout', '/parameter_events'}


@pytest.fixture
def make(monkeypatch):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'OFF')
    made = []

    def make(node_type, *parameters):
        arguments = [part for each in parameters for part in ('-p', each)]
        rclpy.init(args=['--ros-args', *arguments] if arguments else [])
        made.append(node_type())
        return made[-1]

    yield make
    for node in made:
        node.destroy_node()
    rclpy.try_shutdown()


COURSE = ('road.center:=[0.0, 0.0]', 'goal.position:=[10.0, 0.0]')
SENSOR = ('sensors.names:=[front]', 'trackers.names:=[people]')
MAP = ('map.topic:=map',)
FROM_TOPIC = ('road.type:=corridor', 'road.source:=topic')


def opened(node, direction):
    listed = {
        'out': node.get_publisher_names_and_types_by_node,
        'in': node.get_subscriber_names_and_types_by_node,
    }[direction](node.get_name(), '/')
    return {
        (name, kind)
        for name, kinds in listed
        for kind in kinds
        if name not in OF_ROS and 'transition_event' not in name
    }


def in_table(node, direction, *, stamped=False, clock=True):
    found = set()
    for each in TOPICS:
        if (each.node, each.direction) != (node.get_name(), direction):
            continue
        if each.name == 'cmd_vel' and (each.type.__name__ == 'TwistStamped') != stamped:
            continue
        if each.name == '/clock' and not clock:
            continue
        full = each.name.replace('~', f'/{node.get_name()}').replace('<namespace>', '/r2')
        package = each.type.__module__.partition('.')[0]
        found.add((full if full[0] == '/' else f'/{full}', f'{package}/msg/{each.type.__name__}'))
    return found


@pytest.mark.parametrize('stamped', [False, True])
def test_guidance_opens_what_the_table_says(make, stamped):
    more = (
        'moving_obstacles.capacity:=2',
        "others.namespaces:=['/r2']",
        *FROM_TOPIC,
        *SENSOR,
        *MAP,
    )
    node = make(
        GuidanceNode,
        *COURSE,
        'autostart:=true',
        f'enable_stamped_cmd_vel:={str(stamped).lower()}',
        *more,
    )
    for direction in ('in', 'out'):
        assert opened(node, direction) == in_table(node, direction, stamped=stamped)


def test_an_active_node_that_is_destroyed_gives_the_collector_back(make):
    node = make(GuidanceNode, *COURSE, 'autostart:=true')
    assert not gc.isenabled()
    node.destroy_node()
    assert gc.isenabled()


@pytest.mark.parametrize('clock', [False, True])
def test_simulator_opens_what_the_table_says(make, clock):
    moves = (
        'moving_obstacles.names:=[cart]',
        'moving_obstacles.cart.center:=[1.0, 2.0]',
        'moving_obstacles.cart.velocity:=[0.5, 0.0]',
        'moving_obstacles.cart.radius:=0.3',
        'sim.people.names:=[ann]',
        'sim.people.ann.position:=[3.0, 2.0]',
    )
    more = (*moves, *FROM_TOPIC, 'sim.scan.rate:=10.0')
    node = make(SimNode, f'publish_clock:={str(clock).lower()}', *more)
    for direction in ('in', 'out'):
        assert opened(node, direction) == in_table(node, direction, clock=clock)


def test_the_recorder_opens_what_the_table_says(make, tmp_path):
    node = make(Recorder, f'output:={tmp_path / "bag"}')
    assert opened(node, 'out') == in_table(node, 'out')
    node.stop()


def test_what_only_repeats_other_topics_is_not_recorded():
    recorded = own_topics('/r1')
    assert {'/r1/odom', '/r1/guidance/predicted_path', '/r1/sim/truth', '/diagnostics'} <= recorded
    assert '/r1/guidance/plan_markers' not in recorded


RELIABLE, BEST_EFFORT = ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT
VOLATILE, LATCHED = DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL


@pytest.mark.parametrize('reliability', [RELIABLE, BEST_EFFORT])
@pytest.mark.parametrize('durability', [VOLATILE, LATCHED])
def test_what_one_publisher_offered_is_offered_again(reliability, durability):
    before = QoSProfile(depth=7, reliability=reliability, durability=durability)
    after = offering([for_bag(before)])
    assert (after.depth, after.reliability, after.durability) == (7, reliability, durability)


def test_of_several_the_strongest():
    profiles = [
        QoSProfile(depth=3, reliability=BEST_EFFORT, durability=LATCHED),
        QoSProfile(depth=9, reliability=RELIABLE, durability=VOLATILE),
    ]
    offer = offering([for_bag(each) for each in profiles])
    assert (offer.depth, offer.reliability, offer.durability) == (9, RELIABLE, LATCHED)


def test_where_nothing_is_known_it_reaches_everybody():
    offer = offering([])
    assert (offer.depth, offer.reliability, offer.durability) == (10, RELIABLE, VOLATILE)


def test_no_bag_can_ask_for_all_memory():
    assert offering([for_bag(QoSProfile(depth=2**31 - 1))]).depth == 10_000
    assert offering([for_bag(QoSProfile(depth=7))._replace(depth=0)]).depth == 1


def test_a_type_that_is_installed():
    assert message_class('nav_msgs/msg/Odometry') is Odometry


@pytest.mark.parametrize(
    'name',
    [
        '',
        'Odometry',
        'a/b/c',
        'nav_msgs/msg/Nothing',
        'nav_msgs/msg/__doc__',
        'nav_msgs/srv/GetMap',
        'nav_msgs.msg/msg/Odometry',
        '../nav_msgs/msg/Odometry',
        'no_msgs/msg/Odometry',
    ],
)
def test_a_type_that_is_not(name):
    with pytest.raises(UnknownTypeError, match='wanted one that is installed here'):
        message_class(name)


def test_a_package_without_messages_is_not_even_imported():
    assert 'antigravity' not in sys.modules
    with pytest.raises(UnknownTypeError):
        message_class('antigravity/msg/Flight')
    assert 'antigravity' not in sys.modules
