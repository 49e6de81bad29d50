"""Message classes by name, and nothing else that a bag may name."""

from __future__ import annotations

import sys

import pytest
from nav_msgs.msg import Odometry

from cmpsp_ros.bags import UnknownTypeError
from cmpsp_ros.nodes.common.message_types import message_class


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
