"""The recorder's parameters, and the topics that they choose."""

from collections.abc import Container
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.node import Node
from rclpy.parameter import Parameter

from cmpsp_ros.bags import Form
from cmpsp_ros.guidance.messages import PeerTrajectory
from cmpsp_ros.nodes.common.runtime import StartupError
from cmpsp_ros.nodes.common.topics import TOPICS

# Recorded with any choice of topics: without them a run cannot be replayed.
ALWAYS: Final = ('/clock', '/parameter_events')

# Type of `~/parameters` of any node, which is always recorded, too.
_PARAMETER_EVENT: Final = 'rcl_interfaces/msg/ParameterEvent'
_NAMES: Final = Parameter.Type.STRING_ARRAY

# fmt: off
_PARAMETERS: Final[tuple[tuple[str, Any, str, tuple[float, float] | None], ...]] = (
    ('output', '', 'Folder of the new bag; must not exist. Required.', None),
    ('discovery_period', 0.1, 'Time between two checks of the graph [s].', (0.01, 10.0)),
    ('topics', _NAMES, 'Topics to record.', None),
    ('own_topics', False,
     'Record those of guidance and sim in the namespace of this node, and plans of all robots.',
     None),
    ('exclude_topics', _NAMES, 'Topics not to record; all others are, if none is chosen.', None),
    ('storage', 'mcap', 'Format of the files: mcap or sqlite3.', None),
    ('compression', 'zstd', 'Compression of the chunks of mcap: none or zstd.', None),
    ('split_size', 0.0, 'Size at which a new file is begun [MB]; 0: a single file.', (0.0, 1e6)),
    ('split_duration', 0.0, 'Duration after which a new file is begun [s]; 0: a single file.',
     (0.0, 1e9)),
)
# fmt: on
_CHOICES: Final = {'storage': ('mcap', 'sqlite3'), 'compression': ('none', 'zstd')}


@dataclass(frozen=True)
class Options:
    """Choice of topics and format of a recording.

    Chosen are topics listed by name and a robot's own, or all when empty. With the topics of a
    robot come the plans of all robots, which a replay needs.
    """

    output: Path
    form: Form
    discovery_period: float
    listed: frozenset[str]
    chosen: frozenset[str]
    own: bool
    excluded: frozenset[str]

    def want(self, name: str, types: Container[str], of_nodes: Container[str] = ()) -> bool:
        """True if a topic is to be recorded; hidden ones and those `of_nodes` only if chosen."""
        if name in self.excluded:
            return False
        if self.chosen:
            own = self.own and (name in of_nodes or name.endswith(PeerTrajectory.topic('')))
            return own or name in self.chosen or _PARAMETER_EVENT in types
        return not any(part.startswith('_') for part in name.split('/'))


def read_options(node: Node) -> Options:
    """Declare the recorder's parameters and read them; raises StartupError."""
    found: dict[str, Any] = {}
    for name, default, text, bounds in _PARAMETERS:
        descriptor = ParameterDescriptor(description=text, read_only=True)
        if bounds is not None:
            low, high = bounds
            descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
        is_sqlite = name == 'compression' and found['storage'] != 'mcap'
        value = node.declare_parameter(name, 'none' if is_sqlite else default, descriptor).value
        wanted = _CHOICES.get(name, (value,))
        if value not in wanted:
            raise StartupError(f'parameter {name}: expected {" or ".join(wanted)}, got {value!r}')
        found[name] = value
    if not found['output']:
        raise StartupError('parameter output: expected the folder of the new bag, got nothing')
    listed, excluded = (
        frozenset(node.resolve_topic_name(name) for name in found[key] or [])
        for key in ('topics', 'exclude_topics')
    )
    own = found['own_topics']
    chosen = listed | (own_topics(node.get_namespace()) if own else frozenset())
    size, duration = round(found['split_size'] * 1e6), round(found['split_duration'] * 1e9)
    return Options(
        Path(found['output']).expanduser(),
        Form(found['storage'], found['compression'] == 'zstd', size, duration),
        found['discovery_period'],
        listed,
        chosen.union(ALWAYS) if chosen else chosen,
        own,
        excluded,
    )


def own_topics(namespace: str) -> frozenset[str]:
    """Full names of the topics of guidance and sim in a namespace, but hidden and repeated ones."""
    root = namespace.rstrip('/')
    return frozenset(
        each.name if each.name.startswith('/') else f'{root}/{each.name.replace("~", each.node)}'
        for each in TOPICS
        if each.direction != 'srv' and not each.repeats and '/_' not in each.name
    )


def topics_of_nodes(node: Node) -> frozenset[str]:
    """Topics of guidance and sim in the namespace of a node, by their remapped names."""
    namespace, found = node.get_namespace(), set[str]()
    present = {name for name, at in node.get_node_names_and_namespaces() if at == namespace}
    for name in {'guidance', 'sim'} & present:
        for listed in (
            node.get_publisher_names_and_types_by_node,
            node.get_subscriber_names_and_types_by_node,
        ):
            found.update(topic for topic, _ in listed(name, namespace))
    repeated = (each.name.replace('~', '') for each in TOPICS if each.repeats)
    left_out = ('/rosout', '/transition_event', *repeated)
    return frozenset(each for each in found if '/_' not in each and not each.endswith(left_out))
