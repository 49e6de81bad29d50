"""The policy of SROS2 gives the nodes what they need and no more; without keys none starts."""

import sys
from fnmatch import fnmatchcase
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2

from cmpsp_ros.bags import BagWriter
from cmpsp_ros.nodes import MODULES
from cmpsp_ros.nodes.common.topics import TOPICS

CONFIG = Path(__file__).parents[2] / 'config'
NODES = ('guidance', 'sim', 'recorder', 'viewer', 'player')
ENFORCED = {'ROS_SECURITY_ENABLE': 'true', 'ROS_SECURITY_STRATEGY': 'Enforce'}


def granted():
    """(node, right, name) of the policy."""
    root = ET.parse(CONFIG / 'cmpsp.policy.xml').getroot()
    for profile in root.iter('profile'):
        for listed in profile:
            (right,) = listed.attrib
            for each in listed:
                name = each.text if each.text[0] == '/' else f'/{each.text}'
                yield profile.get('node'), right, name


# What may go unused: transforms, actions and a bond, for tf2 and Nav2 are not on the Python package
# index, and topics of the table, which may hang on parameters that are not set here.
TRANSFORMS = {('guidance', 'subscribe', each) for each in ('/tf', '/tf_static')}
OPTIONAL = (
    TRANSFORMS
    | {('sim', 'publish', each) for each in ('/tf', '/tf_static')}
    | {('guidance', 'publish', '/bond')}
    | {each for each in granted() if '/_action/' in each[2]}
    | {
        (each.node, {'in': 'subscribe', 'out': 'publish', 'srv': 'reply'}[each.direction], name)
        for each in TOPICS
        if (
            name := '/'
            + each.name.replace('~', each.node).replace('<namespace>', '*').removeprefix('/')
        )
    }
)


def used(node):
    """(node, right, name) of everything in the graph."""
    looks = {
        'publish': node.get_publisher_names_and_types_by_node,
        'subscribe': node.get_subscriber_names_and_types_by_node,
        'reply': node.get_service_names_and_types_by_node,
        'request': node.get_client_names_and_types_by_node,
    }
    present = set(node.get_node_names())
    return {
        (name, right, each)
        for name in NODES
        if name in present
        for right, look in looks.items()
        for each, _ in look(name, '/')
    }


def covers(grant, use):
    return grant[:2] == use[:2] and fnmatchcase(use[2], grant[2])


@pytest.fixture
def start(spawn, tmp_path):
    """Start all nodes, with everything that they can be told to listen to."""
    bag = tmp_path / 'played'
    with BagWriter(bag) as writer:
        for name, message in (
            ('/odom', Odometry()),
            ('/moving_obstacles', PointCloud2()),
            ('/goal_pose', PoseStamped()),
        ):
            kind = f'{type(message).__module__.partition(".")[0]}/msg/{type(message).__name__}'
            writer.topic(name, kind)
            writer.write(name, 1_000_000_000, serialize_message(message))

    def node(name, *parameters, file=None):
        given = [] if file is None else ['--params-file', CONFIG / file]
        given += [part for each in parameters for part in ('-p', each)]
        spawn([sys.executable, '-m', MODULES[name], '--ros-args', *given])

    node('guidance_node', 'use_sim_time:=true', 'autostart:=true', file='moving.yaml')
    node('sim_node', 'publish_clock:=true', file='moving.yaml')
    node('viewer', 'port:=0', 'use_sim_time:=true')
    node('recorder', f'output:={tmp_path / "bag"}', 'own_topics:=true', 'use_sim_time:=true')
    spawn([sys.executable, '-m', 'cmpsp_ros.cli', 'play', bag, '--paused'])


def test_the_nodes_use_all_that_they_are_granted_and_nothing_else(start, ros):
    grants = set(granted()) - OPTIONAL
    assert len(grants) > 40

    def unused(found):
        """A recorder hears what is published."""
        return [
            each
            for each in grants
            if not any(covers(each, use) for use in found)
            and '*' not in each[2]
            and (each[:2] != ('recorder', 'subscribe') or ros.node.count_publishers(each[2]))
        ]

    try:
        ros.spin_until(lambda: len(found := used(ros.node)) > len(grants) and not unused(found))
    except AssertionError:
        pytest.fail(f'granted and never used: {unused(used(ros.node))}')
    beyond = {use for use in used(ros.node) if not any(covers(each, use) for each in granted())}
    assert beyond == set()


def started(spawn, **env):
    return spawn(
        [
            *(sys.executable, '-m', 'cmpsp_ros.nodes.guidance.node', '--ros-args'),
            *('--enclave', '/cmpsp/guidance', '--params-file', CONFIG / 'case3.yaml'),
        ],
        **ENFORCED,
        **env,
    )


def test_without_keys_no_node_starts_in_the_clear(spawn, tmp_path):
    running = started(spawn, ROS_SECURITY_KEYSTORE=str(tmp_path / 'keys'))
    assert running.wait() == 1
    assert 'SECURITY ERROR' in running.stderr
    assert f'{tmp_path}/keys/enclaves/cmpsp/guidance' in running.stderr
    assert 'Traceback' not in running.stderr


def test_with_keys_that_are_none_no_node_starts_either(spawn, ros, tmp_path):
    enclave = tmp_path / 'keys' / 'enclaves' / 'cmpsp' / 'guidance'
    enclave.mkdir(parents=True)
    for name in (
        *('identity_ca.cert.pem', 'cert.pem', 'key.pem'),
        *('permissions_ca.cert.pem', 'governance.p7s', 'permissions.p7s'),
    ):
        (enclave / name).write_text('')
    running = started(spawn, ROS_SECURITY_KEYSTORE=str(tmp_path / 'keys'))
    assert running.wait() == 1
    assert 'guidance' not in ros.node.get_node_names()
