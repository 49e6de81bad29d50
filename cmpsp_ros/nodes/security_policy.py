"""Rights of each node on the graph as a policy of SROS2: no more than it needs.

`python -m cmpsp_ros.nodes.security_policy config/cmpsp.policy.xml` writes it for nodes without a
namespace; with `--namespace /r1` before the file, for those of a robot in one.
"""

import argparse
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final
from xml.etree import ElementTree as ET

from cmpsp_ros.nodes.common import topics
from cmpsp_ros.nodes.common.topic import Topic
from cmpsp_ros.nodes.guidance.inputs.goals import FOLLOW, NAVIGATE
from cmpsp_ros.nodes.recording.options import ALWAYS, own_topics

_HEADER: Final = """<?xml version="1.0" encoding="UTF-8"?>
<!-- Rights of the nodes of cmpsp_ros for SROS2; doc/user/security.md says how to use them.
     Written by: python -m cmpsp_ros.nodes.security_policy config/cmpsp.policy.xml -->
"""

# fmt: off
_NODE_SERVICES: Final = (
    'describe_parameters', 'get_parameter_types', 'get_parameters', 'get_type_description',
    'list_parameters', 'set_parameters', 'set_parameters_atomically',
)
_LIFECYCLE_SERVICES: Final = (
    'change_state', 'get_available_states', 'get_available_transitions', 'get_state',
    'get_transition_graph',
)
_ACTION_SERVICES: Final = 'cancel_goal', 'get_result', 'send_goal'
_ACTION_TOPICS: Final = 'feedback', 'status'
# fmt: on

_TF: Final = {'/tf', '/tf_static'}


@dataclass
class Rights:
    """Rights of one node; names below its namespace, or absolute, with `*` for anything."""

    node: str
    publish: set[str] = field(default_factory=set)
    subscribe: set[str] = field(default_factory=set)
    reply: set[str] = field(default_factory=set)
    request: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.publish |= {'/rosout', '/parameter_events'}
        self.reply |= {f'{self.node}/{name}' for name in _NODE_SERVICES}
        places = {'in': self.subscribe, 'out': self.publish, 'srv': self.reply}
        for each in topics.TOPICS:
            if each.node == self.node:
                places[each.direction].add(_name(each))


def rights() -> tuple[Rights, ...]:
    """Rights of all nodes: those in the table of topics, and these."""
    absolute = {each.name for each in topics.TOPICS if each.name.startswith('/')}
    recorded = {each if each in absolute else each[1:] for each in own_topics('/')}
    shown = (
        topics.GUIDANCE_ODOM,
        topics.DECISION,
        topics.PLAN,
        topics.MARKERS,
        topics.PLAN_MARKERS,
        topics.SIGHTING,
        topics.SIM_WHEELS,
        topics.CLOCK,
    )
    played = topics.GUIDANCE_ODOM, topics.GUIDANCE_MOVING, topics.GOAL_POSE, topics.CLOCK
    actions = [f'{action}/_action' for action in (NAVIGATE, FOLLOW)]
    return (
        Rights(
            'guidance',
            publish={
                'guidance/transition_event',
                'bond',
                *(f'{action}/{name}' for action in actions for name in _ACTION_TOPICS),
            },
            # The clock is for use_sim_time, as with the viewer; the recorder hears it anyway.
            subscribe={topics.CLOCK.name, *_TF},
            reply={
                *(f'guidance/{name}' for name in _LIFECYCLE_SERVICES),
                *(f'{action}/{name}' for action in actions for name in _ACTION_SERVICES),
            },
        ),
        Rights('sim', publish=set(_TF)),
        Rights('recorder', subscribe={*recorded, _name(topics.OTHER_PLANS), *ALWAYS, *_TF}),
        Rights('viewer', subscribe=set(map(_name, shown)), request={'guidance/get_parameters'}),
        Rights(
            'player',
            publish=set(map(_name, played)),
            reply={f'player/{name}' for name in ('pause', 'resume', 'toggle_paused')},
        ),
    )


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
    """Name in a policy; other robots may be in any namespace."""
    return topic.name.replace('~', topic.node).replace('<namespace>', '/*')


def main() -> None:
    """Write the policy into a file."""
    parser = argparse.ArgumentParser(description=main.__doc__)
    parser.add_argument('--namespace', default='/', help='of the nodes, as in /r1')
    parser.add_argument('file', type=Path)
    given = parser.parse_args()
    given.file.write_text(policy(given.namespace), encoding='utf-8')


if __name__ == '__main__':
    main()
