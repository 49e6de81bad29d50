"""The policy of SROS2 is what the code grants, in the form that `ros2 security` reads."""

import re
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest

from cmpsp_ros.nodes.common.topics import TOPICS
from cmpsp_ros.nodes.security_policy import policy, rights

FILE = Path(__file__).parents[3] / 'config' / 'cmpsp.policy.xml'

# As of the schema of sros2 0.13, policy version 0.2.0.
ATTRIBUTES = {'topics': {'publish', 'subscribe'}, 'services': {'reply', 'request'}}
NAME = re.compile(r'/?(\*|[a-z_]\w*)(/(\*|[a-z_]\w*))*')


def test_the_file_is_what_the_code_grants():
    assert FILE.read_text(encoding='utf-8') == policy()


@pytest.mark.parametrize('namespace', ['/', '/r1', '/fleet/r1'])
def test_it_has_the_form_of_a_policy(namespace):
    root = ET.fromstring(policy(namespace))
    assert (root.tag, root.attrib) == ('policy', {'version': '0.2.0'})
    (enclaves,) = root
    assert enclaves.tag == 'enclaves'
    nodes = []
    for enclave in enclaves:
        assert set(enclave.attrib) == {'path'}
        ((profile,),) = enclave
        assert enclave[0].tag == 'profiles'
        assert profile.attrib == {'ns': namespace, 'node': profile.get('node')}
        prefix = '' if namespace == '/' else namespace
        assert enclave.get('path') == f'{prefix}/cmpsp/{profile.get("node")}'
        nodes.append(profile.get('node'))
        for listed in profile:
            ((right, value),) = listed.attrib.items()
            assert right in ATTRIBUTES[listed.tag]
            assert value == 'ALLOW'
            names = [each.text for each in listed]
            assert {f'{each.tag}s' for each in listed} == {listed.tag}
            assert names == sorted(set(names))
            assert all(map(NAME.fullmatch, names)), names
    assert nodes == ['guidance', 'sim', 'recorder', 'viewer', 'player']


def test_only_the_guidance_node_may_command():
    may = [each.node for each in rights() if 'cmd_vel' in each.publish]
    assert may == ['guidance']


def test_nobody_may_change_what_another_node_does():
    asked = {name.rpartition('/')[2] for each in rights() for name in each.request}
    assert asked == {'get_parameters'}


def test_everything_in_the_table_of_topics_is_granted_to_its_node():
    by_node = {each.node: each for each in rights()}
    for topic in TOPICS:
        granted = by_node[topic.node]
        names = {'in': granted.subscribe, 'out': granted.publish, 'srv': granted.reply}
        name = topic.name.replace('~', topic.node).replace('<namespace>', '/*')
        assert name in names[topic.direction]
