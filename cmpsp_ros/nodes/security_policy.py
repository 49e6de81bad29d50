"""What each node may do on the graph, as a policy of SROS2: no more than it needs.

`python -m cmpsp_ros.nodes.security_policy config/cmpsp.policy.xml` writes it for nodes without a
namespace; with `--namespace /r1` before the file, for those of a robot in one.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final
from xml.etree import ElementTree as ET

from cmpsp_ros.nodes.common.topics import (
    CLOCK,
    DECISION,
    GOAL_POSE,
    GUIDANCE_MOVING,
    GUIDANCE_ODOM,
    MARKERS,
    OTHER_PLANS,
    PLAN,
    PLAN_MARKERS,
    SIGHTING,
    SIM_WHEELS,
    TOPICS,
    Topic,
)
from cmpsp_ros.nodes.guidance.inputs.goals import FOLLOW, NAVIGATE
from cmpsp_ros.nodes.recording.options import ALWAYS, own_topics

_HEADER: Final = """<?xml version="1.0" encoding="UTF-8"?>
<!-- Rights of the nodes of cmpsp_ros for SROS2; doc/user/security.md says how to use them.
     Written by: python -m cmpsp_ros.nodes.security_policy config/cmpsp.policy.xml -->
"""

_OF_NODES: Final = (
    'describe_parameters',
    'get_parameter_types',
    'get_parameters',
    'get_type_description',
    'list_parameters',
    'set_parameters',
    'set_parameters_atomically',
)
"""Services of every node."""

_OF_LIFECYCLE_NODES: Final = (
    'change_state',
    'get_available_states',
    'get_available_transitions',
    'get_state',
    'get_transition_graph',
)


_OF_ACTIONS: Final = ('cancel_goal', 'get_result', 'send_goal')
"""Services of every action."""


@dataclass
class Rights:
    """Of one node; names below its namespace, or absolute, with `*` for anything.

    Attributes:
        node: Its name, and that of its enclave.
        publish: Topics.
        subscribe: Topics.
        reply: Services that it offers.
        request: Services that it calls.
    """

    node: str
    publish: set[str] = field(default_factory=set)
    subscribe: set[str] = field(default_factory=set)
    reply: set[str] = field(default_factory=set)
    request: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.publish |= {'/rosout', '/parameter_events'}
        self.reply |= {f'{self.node}/{name}' for name in _OF_NODES}


def rights() -> tuple[Rights, ...]:
    """Of all nodes."""
    return _guidance(), _simulator(), _recorder(), _viewer(), _player()


def policy(namespace: str = '/') -> str:
    """The policy for nodes in a namespace, each with an enclave of its own in `/cmpsp`."""
    root = ET.Element('policy', version='0.2.0')
    enclaves = ET.SubElement(root, 'enclaves')
    for each in rights():
        path = f'{namespace.rstrip("/")}/cmpsp/{each.node}'
        enclave = ET.SubElement(enclaves, 'enclave', path=path)
        profiles = ET.SubElement(enclave, 'profiles')
        profile = ET.SubElement(profiles, 'profile', ns=namespace, node=each.node)
        for kind, right, names in (
            ('topic', 'publish', each.publish),
            ('topic', 'subscribe', each.subscribe),
            ('service', 'reply', each.reply),
            ('service', 'request', each.request),
        ):
            if names:
                listed = ET.SubElement(profile, f'{kind}s', {right: 'ALLOW'})
                for name in sorted(names):
                    ET.SubElement(listed, kind).text = name
    ET.indent(root)
    return f'{_HEADER}{ET.tostring(root, encoding="unicode")}\n'


def _name(topic: Topic) -> str:
    """In a policy; other robots may be in any namespace."""
    return topic.name.replace('~', topic.node).replace('<namespace>', '/*')


def _of_table(node: str) -> Rights:
    """What the table of topics says of a node."""
    found = Rights(node)
    places = {'in': found.subscribe, 'out': found.publish, 'srv': found.reply}
    for each in TOPICS:
        if each.node == node:
            places[each.direction].add(_name(each))
    return found


def _guidance() -> Rights:
    found = _of_table('guidance')
    found.reply |= {f'guidance/{name}' for name in _OF_LIFECYCLE_NODES}
    found.publish.add('guidance/transition_event')
    for action in (NAVIGATE, FOLLOW):
        found.reply |= {f'{action}/_action/{name}' for name in _OF_ACTIONS}
        found.publish |= {f'{action}/_action/{name}' for name in ('feedback', 'status')}
    found.publish.add('bond')
    # For use_sim_time, as with the viewer; the recorder hears it anyway.
    found.subscribe |= {CLOCK.name, '/tf', '/tf_static'}
    return found


def _simulator() -> Rights:
    found = _of_table('sim')
    found.publish |= {'/tf', '/tf_static'}
    return found


def _recorder() -> Rights:
    """With `own_topics`."""
    found = _of_table('recorder')
    absolute = {each.name for each in TOPICS if each.name.startswith('/')}
    found.subscribe |= {each if each in absolute else each[1:] for each in own_topics('/')}
    found.subscribe.add(_name(OTHER_PLANS))
    found.subscribe |= {*ALWAYS, '/tf', '/tf_static'}
    return found


def _viewer() -> Rights:
    found = Rights('viewer')
    own = GUIDANCE_ODOM, DECISION, PLAN, MARKERS, PLAN_MARKERS, SIGHTING, SIM_WHEELS, CLOCK
    found.subscribe |= {_name(each) for each in own}
    found.request.add('guidance/get_parameters')
    return found


def _player() -> Rights:
    """To play what the guidance node hears, and the clock."""
    found = Rights('player')
    found.publish |= {_name(each) for each in (GUIDANCE_ODOM, GUIDANCE_MOVING, GOAL_POSE, CLOCK)}
    found.reply |= {f'player/{name}' for name in ('pause', 'resume', 'toggle_paused')}
    return found


def main() -> None:
    """Write the policy into a file."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument('--namespace', default='/', help='of the nodes, as in /r1')
    parser.add_argument('file', type=Path)
    given = parser.parse_args()
    given.file.write_text(policy(given.namespace), encoding='utf-8')


if __name__ == '__main__':
    main()
