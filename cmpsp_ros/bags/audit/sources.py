"""Read a bag for its audit: choice of node and topics, and their messages."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from cmpsp_ros.bags.audit.history import read_history
from cmpsp_ros.bags.audit.legs import Leg, pair, read_commands, split, timed
from cmpsp_ros.bags.audit.record import AuditRecord
from cmpsp_ros.bags.decision_record import read_decisions, wheel_speeds
from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.names import Names
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.bags.runs.odometry import OdometrySeries, path_through, read_odometry
from cmpsp_ros.bags.runs.run import ReceivedTracks, read_tracks, truth_topic

_NODE = 'guidance'


@dataclass(frozen=True)
class Sources:
    """Choice of topics, of parameters to judge by, and of a namespace as `/r1`; None: the bag's."""

    odom: str | None = None
    cmd_vel: str | None = None
    params_file: str | Path | None = None
    namespace: str | None = None


def find(bag: Bag, sources: Sources) -> Names:
    """Full names of everything that an audit reads."""
    node = _node(bag, sources)
    namespace = node.rpartition('/')[0]
    return Names(
        _topic(bag, sources.odom or bag.as_decided_on(node, 'odom'), '--odom'),
        _topic(bag, sources.cmd_vel or f'{namespace}/cmd_vel', '--cmd-vel'),
        node,
    )


def read_record(path: Path, sources: Sources | None = None) -> AuditRecord:
    """Read the data of an audit; raises BagError, or ParameterError for unusable parameters."""
    sources = sources or Sources()
    with Bag(path) as bag:
        try:
            return _record(bag, sources)
        except OverflowError as error:
            raise BagError(f'{path}: found times that no clock can have: {error}') from error


def _record(bag: Bag, sources: Sources) -> AuditRecord:
    places = find(bag, sources)
    history = read_history(bag, places, sources.params_file)
    settings = history.epochs[0].settings
    frame_id = settings.frame_id if 'frame_id' in history.given else None
    odometry = read_odometry(bag, places.odom, frame_id)
    if frame_id is None:
        # Distances are known in one frame only.
        frame_id = next(bag.messages(places.odom))[1].header.frame_id
    commands = read_commands(bag, places.cmd_vel)
    # Of those that came too late no command was sent.
    decisions = tuple(each for each in read_decisions(bag, places.decision) if not each.late)
    decided = settings.robot.twist_of_wheels(wheel_speeds(decisions))
    pairs = pair(commands, decided)
    commands = timed(commands, odometry, pairs, decisions)
    truth_on = truth_topic(bag, places.namespace, places.odom)
    truth = read_odometry(bag, truth_on, frame_id) if truth_on else None
    legs = tuple(split(odometry, truth, commands, decisions, history))
    if not legs:
        raise bag.error(
            f'found no two messages of {places.odom} around any of {places.cmd_vel}, wanted a drive'
        )
    moving = bag.as_decided_on(places.node, 'moving_obstacles')
    topics = moving, places.tracks, places.people
    found = [[read_tracks(bag, each, frame_id, leg.window) for each in topics] for leg in legs]
    told, seen, people = (
        ' '.join(dict.fromkeys(each.refused for each in some if each.refused))
        for some in zip(*found, strict=True)
    )
    names = [each for each in settings.moving_obstacles.others if each != places.namespace]
    others, unknown = _others(bag, names, frame_id)
    return AuditRecord(
        path=bag.path,
        places=places,
        history=history,
        odometry=odometry,
        commands=commands,
        decisions=decisions,
        others=tuple(others),
        unusable={
            'moving': ' '.join(filter(None, (told, seen))),
            'people': people,
            'others': unknown,
        },
        pairs=pairs,
        is_ours=places.node in bag.parameters,
        legs=tuple(_with_moving_objects(*each, others) for each in zip(legs, found, strict=True)),
    )


def _with_moving_objects(
    leg: Leg, received: Sequence[ReceivedTracks], others: Mapping[str, OdometrySeries]
) -> Leg:
    """A leg with all that moved then: obstacles told and seen, people, and other robots."""
    told, seen, people = (each.tracks for each in received)
    heard = {name: each.received_within(*leg.window) for name, each in others.items()}
    paths = {name: path_through(each) for name, each in heard.items() if each is not None}
    return replace(leg, tracks=told + seen, people=people, others=paths)


def _others(bag: Bag, names: Sequence[str], frame_id: str) -> tuple[dict[str, OdometrySeries], str]:
    """Poses of other robots by namespace, the true ones if known; those lacking, in sentences."""
    known, lacking = {}, []
    for each in names:
        heard = bag.as_decided_on(f'{each}/guidance', 'odom')
        try:
            topic = _topic(bag, truth_topic(bag, each, heard) or heard, '--odom')
            known[each] = read_odometry(bag, topic, frame_id)
        except BagError as error:
            reason = str(error).removeprefix(f'{bag.path}: ')
            lacking.append(f'The path of {each} is not known: {reason.rstrip(".")}.')
    return known, ' '.join(lacking)


def _node(bag: Bag, sources: Sources) -> str:
    nodes = sorted(name for name in bag.parameters if name.rpartition('/')[2] == _NODE)
    if sources.namespace is not None:
        wanted = f'{sources.namespace.rstrip("/")}/{_NODE}'
        if wanted not in nodes and sources.params_file is None:
            there = ', '.join(nodes) or 'none'
            raise bag.error(f'found no parameters of {wanted}; there are those of {there}')
        return wanted
    if sources.odom is not None:
        # The odometry's namespace says which robot is meant.
        beside = f'{sources.odom.rpartition("/")[0]}/{_NODE}'
        nodes = [beside] if beside in nodes else nodes
    if len(nodes) > 1:
        raise bag.error(
            f'found parameters of {", ".join(nodes)}, wanted one of them:'
            f' choose a robot by its odometry, as in --odom {nodes[0].rpartition("/")[0]}/odom'
        )
    if nodes:
        return nodes[0]
    if sources.params_file is None:
        raise bag.error(
            'found no parameters of a guidance node, wanted them in the bag'
            ' or in a file (--params-file)'
        )
    return ''


def _topic(bag: Bag, name: str, option: str) -> str:
    if name in bag.topics and bag.topics[name].count:
        return name
    found = 'no message in' if name in bag.topics else 'no topic'
    there = ', '.join(sorted(topic for topic, each in bag.topics.items() if each.count))
    wanted = f'wanted one of {there}' if there else 'nor in any other, wanted a drive'
    raise bag.error(f'found {found} {name}, {wanted} ({option})')
