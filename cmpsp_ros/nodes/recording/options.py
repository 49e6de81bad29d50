"""The parameters of the recorder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.parameter import Parameter

from cmpsp_ros.bags import Form
from cmpsp_ros.guidance.messages import PeerTrajectory
from cmpsp_ros.nodes.common.runtime import StartupError
from cmpsp_ros.nodes.common.topics import TOPICS

if TYPE_CHECKING:
    from collections.abc import Container

    from rclpy.node import Node

ALWAYS = ('/clock', '/parameter_events')
"""Recorded with any choice of topics: without them a run cannot be replayed."""

_PARAMETERS = 'rcl_interfaces/msg/ParameterEvent'
"""Type of `~/parameters` of any node, which is always recorded, too."""

_NAMES = Parameter.Type.STRING_ARRAY

_STORAGES = ('mcap', 'sqlite3')
_COMPRESSIONS = ('none', 'zstd')


@dataclass(frozen=True)
class Options:
    """How to record.

    Attributes:
        output: Folder of the new bag.
        form: Its format.
        discovery_period: Time between two checks of the graph [s].
        listed: Topics given by name.
        chosen: Topics to record; all when empty.
        own: Whether those of one robot are chosen, and with them the plans of all robots, which a
            replay needs.
        excluded: Topics not to record.
    """

    output: Path
    form: Form
    discovery_period: float
    listed: frozenset[str]
    chosen: frozenset[str]
    own: bool
    excluded: frozenset[str]

    def want(self, name: str, types: Container[str], of_nodes: Container[str] = ()) -> bool:
        """Whether a topic is to be recorded; hidden ones only if they are chosen.

        Args:
            name: Of the topic.
            types: Its types.
            of_nodes: Remapped topics of the robot's nodes, which count as its own.
        """
        if name in self.excluded:
            return False
        if self.chosen:
            own = self.own and (name in of_nodes or name.endswith(PeerTrajectory.topic('')))
            return own or name in self.chosen or _PARAMETERS in types
        return not any(part.startswith('_') for part in name.split('/'))


def read_options(node: Node) -> Options:
    """Declare the recorder's parameters and read them.

    Raises:
        StartupError: One is missing or invalid.
    """
    output = _declare(node, 'output', '', 'Folder of the new bag; must not exist. Required.')
    period = _declare(
        node, 'discovery_period', 0.1, 'Time between two checks of the graph [s].', (0.01, 10.0)
    )
    listed = _declare(node, 'topics', _NAMES, 'Topics to record.')
    own = _declare(
        node,
        'own_topics',
        False,
        'Record those of guidance and sim in the namespace of this node, and plans of all robots.',
    )
    excluded = _declare(
        node, 'exclude_topics', _NAMES, 'Topics not to record; all others are, if none is chosen.'
    )
    form = _form(node)
    if not output:
        msg = 'parameter output: expected the folder of the new bag, got nothing'
        raise StartupError(msg)
    named = frozenset(node.resolve_topic_name(name) for name in listed or [])
    chosen = named | (own_topics(node.get_namespace()) if own else frozenset())
    return Options(
        Path(output).expanduser(),
        form,
        period,
        named,
        chosen.union(ALWAYS) if chosen else chosen,
        own,
        frozenset(node.resolve_topic_name(name) for name in excluded or []),
    )


def own_topics(namespace: str) -> frozenset[str]:
    """Full names of the topics of guidance and sim in a namespace, including their inputs.

    Hidden topics are left out, as everywhere in ROS, and topics that only repeat others.
    """
    root = namespace.rstrip('/')
    return frozenset(
        each.name if each.name.startswith('/') else f'{root}/{each.name.replace("~", each.node)}'
        for each in TOPICS
        if each.direction != 'srv' and not each.repeats and '/_' not in each.name
    )


def topics_of_nodes(node: Node) -> frozenset[str]:
    """Topics of guidance and sim in the namespace of a node, by their remapped names."""
    namespace, found = node.get_namespace(), set[str]()
    present = set(node.get_node_names_and_namespaces())
    for name in {'guidance', 'sim'} & {name for name, at in present if at == namespace}:
        for listed in (
            node.get_publisher_names_and_types_by_node,
            node.get_subscriber_names_and_types_by_node,
        ):
            found.update(topic for topic, _ in listed(name, namespace))
    repeated = (each.name.replace('~', '') for each in TOPICS if each.repeats)
    left_out = ('/rosout', '/transition_event', *repeated)
    return frozenset(each for each in found if '/_' not in each and not each.endswith(left_out))


def _form(node: Node) -> Form:
    storage = _declare(node, 'storage', 'mcap', 'Format of the files: mcap or sqlite3.')
    default = 'zstd' if storage == 'mcap' else 'none'
    compression = _declare(
        node, 'compression', default, 'Compression of the chunks of mcap: none or zstd.'
    )
    size = _declare(
        node,
        'split_size',
        0.0,
        'Size at which a new file is begun [MB]; 0: a single file.',
        (0, 1e6),
    )
    duration = _declare(
        node,
        'split_duration',
        0.0,
        'Duration after which a new file is begun [s]; 0: a single file.',
        (0, 1e9),
    )
    for name, value, wanted in (
        ('storage', storage, _STORAGES),
        ('compression', compression, _COMPRESSIONS),
    ):
        if value not in wanted:
            msg = f'parameter {name}: expected {" or ".join(wanted)}, got {value!r}'
            raise StartupError(msg)
    return Form(storage, compression == 'zstd', round(size * 1e6), round(duration * 1e9))


def _declare(
    node: Node, name: str, default: Any, text: str, bounds: tuple[float, float] | None = None
) -> Any:
    descriptor = ParameterDescriptor(description=text, read_only=True)
    if bounds is not None:
        low, high = map(float, bounds)
        descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    return node.declare_parameter(name, default, descriptor).value
