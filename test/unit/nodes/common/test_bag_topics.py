"""Topics as bags have them: message classes by name, and quality of service."""

import sys

import pytest
from nav_msgs.msg import Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from cmpsp_ros.bags import UnknownTypeError
from cmpsp_ros.nodes.common.qos import for_bag, offering
from cmpsp_ros.nodes.common.topic import message_class

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
    offer = offering(map(for_bag, profiles))
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
