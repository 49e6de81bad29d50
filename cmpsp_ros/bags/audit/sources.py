"""Where an audit reads from in a bag: parameters of which node, and which topics."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.names import Names
from cmpsp_ros.bags.reader import Bag

_NODE = 'guidance'


@dataclass(frozen=True)
class Sources:
    """The user's choice of sources; None: found in the bag.

    Attributes:
        odom: Topic of the odometry.
        cmd_vel: Topic of the commands.
        params_file: Parameter file or preset to judge by, instead of the parameters in the bag.
        namespace: Of the guidance node, as in `/r1`.
    """

    odom: str | None = None
    cmd_vel: str | None = None
    params_file: str | Path | None = None
    namespace: str | None = None


def find(bag: Bag, sources: Sources) -> Names:
    """Full names of everything that an audit reads.

    Raises:
        BagError: The bag has no parameters of a guidance node and no file replaces them, or those
            of several nodes and none is chosen; or odometry or commands are missing.
    """
    node = _node(bag, sources)
    namespace = node.rpartition('/')[0]
    return Names(
        _topic(bag, sources.odom or bag.as_decided_on(node, 'odom'), '--odom'),
        _topic(bag, sources.cmd_vel or f'{namespace}/cmd_vel', '--cmd-vel'),
        node,
    )


def _node(bag: Bag, sources: Sources) -> str:
    nodes = sorted(name for name in bag.parameters if name.rpartition('/')[2] == _NODE)
    if sources.namespace is not None:
        wanted = f'{sources.namespace.rstrip("/")}/{_NODE}'
        if wanted not in nodes and sources.params_file is None:
            there = ', '.join(nodes) or 'none'
            raise BagError(
                f'{bag.path}: found no parameters of {wanted}; there are those of {there}'
            )
        return wanted
    if sources.odom is not None:
        # The odometry's namespace says which robot is meant.
        beside = f'{sources.odom.rpartition("/")[0]}/{_NODE}'
        nodes = [beside] if beside in nodes else nodes
    if len(nodes) > 1:
        raise BagError(
            f'{bag.path}: found parameters of {", ".join(nodes)}, wanted one of them:'
            f' choose a robot by its odometry, as in --odom {nodes[0].rpartition("/")[0]}/odom'
        )
    if nodes:
        return nodes[0]
    if sources.params_file is None:
        raise BagError(
            f'{bag.path}: found no parameters of a guidance node, wanted them in the bag'
            ' or in a file (--params-file)'
        )
    return ''


def _topic(bag: Bag, name: str, option: str) -> str:
    if name in bag.topics and bag.topics[name].count:
        return name
    found = 'no message in' if name in bag.topics else 'no topic'
    there = ', '.join(sorted(topic for topic, each in bag.topics.items() if each.count))
    wanted = f'wanted one of {there}' if there else 'nor in any other, wanted a drive'
    raise BagError(f'{bag.path}: found {found} {name}, {wanted} ({option})')
