"""Inputs and outputs of a guidance node, read from its bag in one pass."""

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from cmpsp_ros.arrays import Array
from cmpsp_ros.bags.custom_data import plain_values
from cmpsp_ros.bags.decision_record import DecisionRecord, Waypoint
from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.names import Names
from cmpsp_ros.bags.reader import PARAMETER_EVENT, Bag
from cmpsp_ros.guidance import Goal, GoalError, messages
from cmpsp_ros.parameters import TABLE, ParameterError, Values, is_of_ros
from cmpsp_ros.sensing import Sighting, grid_of, stamp_of

EVENTS = '/parameter_events'  # topic of the changes


class NodeParameters:
    """The complete set of parameters of one node, from its start on."""

    values: Values  # after all changes applied so far
    given: frozenset[str]  # keys that were recorded; the others are defaults

    def __init__(self, bag: Bag, node: str) -> None:
        self._bag, self._node = bag, node
        self._restarts = list(bag.restarts.get(node, ()))
        if node not in bag.parameters:
            there = ', '.join(sorted(bag.parameters)) or 'no node'
            foreign = f'{node}/decision' not in bag.topics
            hint = ', and no decisions: --params-file makes some' if foreign else ''
            text = f'no parameters of {node}; there are those of {there}{hint}'
            raise bag.error(text)
        bag.require_type(EVENTS, PARAMETER_EVENT)
        self._take(bag.parameters[node])

    def restart(self, until: int) -> int | None:
        """Take the parameters of the next restart until a time [ns]; returns its time, or None."""
        if not self._restarts or self._restarts[0][0] > until:
            return None
        since, given = self._restarts.pop(0)
        self._take(given)
        return since

    def change(self, received: int, changes: Mapping[str, Any], *, used: bool) -> None:
        """Apply a change received at a time [ns]; previous values that were used must be known."""
        unknown = sorted(changes.keys() - self.given)
        if used and unknown:
            raise self._bag.error(
                f'found a change of {unknown[0]} of {self._node} at {received} ns,'
                ' before the recorder could learn what it was; wanted its value from the beginning'
            )
        try:
            self.values = TABLE.reconfigure(self.values, changes)
        except ParameterError as error:
            said = f'change of parameters at {received} ns: {error.problems[0]}'
            raise self._bag.error(said) from error
        self.given = self.given.union(changes)

    def _take(self, given: Mapping[str, Any]) -> None:
        try:
            self.values = TABLE.resolve(given)
        except ParameterError as error:
            said = f'parameters of {self._node}: {error.problems[0]}'
            raise self._bag.error(said) from error
        self.given = frozenset(given)


def changes_in(event: Any, node: str) -> dict[str, Any] | None:
    """New values by key in a message of `/parameter_events`; None for no change of this node."""
    if event.node != node or not event.changed_parameters:
        return None
    changed = plain_values(event.changed_parameters)
    return {key: value for key, value in changed.items() if not is_of_ros(key)}


SLACK = 1_000_000_000  # maximum time in a bag between messages that belong together [ns]
_LATE = 50_000_000  # maximum time by which a command comes into the bag after its decision [ns]
_MAX_MESSAGES = 10_000  # messages of a topic that are kept: more than any robot sends in `SLACK`
_MAX_TRACKS = 100_000  # readings of moving obstacles that are kept


@dataclass(frozen=True)
class OdometrySample:
    """Usable odometry: time of reception and stamp [ns], pose ``(3,)`` [m, m, rad]."""

    received: int
    stamp: int
    pose: Array


class Recording:
    """The messages of one guidance node, in its frame, each kept as long as it may be needed.

    Plans of robots in other namespaces are among them. Its queues have what is not yet used.
    """

    def __init__(self, bag: Bag, names: Names, frame_id: str, others: Iterable[str] = ()) -> None:
        self._bag, self._names, self._frame_id = bag, names, frame_id
        # A node that reports its received goals reports all, in its own frame.
        goal_pose = bag.as_decided_on(names.node, 'goal_pose')
        self._read: dict[str, Callable[[int, Any], None]] = {
            names.odom: self._read_odometry,
            EVENTS: self._read_change,
            names.cmd_vel: self._read_command,
            names.path: self._read_path,
            names.moving: self._read_told,
            f'{names.node}/moving_obstacles': self._read_told,
            names.tracks: self._read_tracks,
            names.sighting: self._read_sighting,
            goal_pose: self._read_goal,
        }
        for topic, namespace in names.others(others).items():
            self._read[topic] = partial(self._read_plan, peer=namespace)
        there = [topic for topic in self._read if topic in bag.topics and topic != names.odom]
        self._topics = [names.odom, names.decision, *there]
        self.odometry: deque[OdometrySample] = deque(maxlen=_MAX_MESSAGES)
        self.unusable = ''  # why the first invalid odometry is invalid; empty if there was none
        # Time of reception [ns] and content of live parameter changes.
        self.changes: deque[tuple[int, dict[str, Any]]] = deque()
        # Time of reception and stamp [ns] of goals.
        self.goals: deque[tuple[int, int, Goal]] = deque(maxlen=_MAX_MESSAGES)
        self._commands: deque[tuple[int, tuple[float, float, float]]] = deque(maxlen=_MAX_MESSAGES)
        self._paths: dict[int, tuple[Waypoint, ...]] = {}
        # Time of reception [ns] and moving obstacle, by the key of a decision.
        self._tracks: dict[tuple[int | str, int], tuple[int, messages.MovingObject]] = {}
        self._sightings: dict[int, Sighting] = {}
        self._first = True

    def decisions(self) -> Iterator[DecisionRecord]:
        """Iterate over the decisions; odometry and changes are read ahead of each."""
        pending: deque[DecisionRecord] = deque()
        for topic, received, message in self._bag.together(self._topics):
            while pending and received > pending[0].received + SLACK:
                yield self._complete(pending.popleft())
            if topic == self._names.decision:
                pending.append(DecisionRecord.of(f'{self._bag.path}: {topic}', received, message))
            else:
                try:
                    self._read[topic](received, message)
                except (AttributeError, TypeError, ValueError) as error:
                    said = f'found a message that is none of its type at {received} ns: {error}'
                    raise self._bag.error(f'{topic}: {said}') from error
            if max(len(pending), len(self._paths), len(self.changes)) > _MAX_MESSAGES:
                raise self._bag.error(f'found over {_MAX_MESSAGES} decisions within a second')
        while pending:
            yield self._complete(pending.popleft())

    def tracks(self, decision: DecisionRecord) -> tuple[messages.MovingObject, ...]:
        """Moving obstacles and plans of other robots as known to a decision, or a `BagError`."""
        for number, stamp in decision.tracks:
            if (number, stamp) not in self._tracks:
                what, topic = f'obstacle {number} as it was seen', self._names.moving
                if isinstance(number, int) and number >= messages.Track.SEEN:
                    topic = self._names.tracks
                if isinstance(number, str):
                    what = f'the plan that {number} made'
                    topic = messages.PeerTrajectory.topic(number)
                raise self._lacks(decision, what, stamp, topic)
        return tuple(self._tracks[key][1] for key in decision.tracks)

    def sighting(self, decision: DecisionRecord) -> Sighting | None:
        """Surroundings as known to a decision; raises `BagError` if they are not in the bag."""
        stamp = decision.sighting
        if stamp is None:
            return None
        for older in [each for each in self._sightings if each < stamp]:
            del self._sightings[older]
        if stamp not in self._sightings:
            raise self._lacks(decision, 'what was seen', stamp, self._names.sighting)
        return self._sightings[stamp]

    def _lacks(self, decision: DecisionRecord, what: str, stamp: int, topic: str) -> BagError:
        found = f'found a decision (stamp {decision.stamp}) on {what} at {stamp} ns'
        return self._bag.error(f'{found}, wanted that in {topic}')

    def _read_odometry(self, received: int, message: Any) -> None:
        try:
            pose = messages.OdometryReading.of(message).pose_in(self._frame_id)
        except messages.OdometryError as error:
            self.unusable = self.unusable or str(error)
        else:
            self.odometry.append(OdometrySample(received, stamp_of(message), pose))

    def _read_command(self, received: int, message: Any) -> None:
        twist = getattr(message, 'twist', message)
        self._commands.append((received, (twist.linear.x, twist.linear.y, twist.angular.z)))

    # The node refused invalid ones, too.
    def _read_told(self, received: int, message: Any) -> None:
        with suppress(messages.TrackError):
            self._note(received, messages.told_tracks_of(message, self._frame_id))

    def _read_tracks(self, received: int, message: Any) -> None:
        with suppress(messages.TrackError):
            self._note(received, messages.tracks_of(message, self._frame_id))

    def _read_plan(self, received: int, message: Any, peer: str) -> None:
        with suppress(messages.TrackError):
            self._note(received, [messages.PeerTrajectory.of(message, peer, self._frame_id)])

    def _read_sighting(self, _received: int, message: Any) -> None:
        stamp = stamp_of(message)
        self._sightings[stamp] = Sighting(stamp, grid_of(message, self._frame_id))

    def _read_goal(self, received: int, message: Any) -> None:
        # The node refuses an invalid goal before it reaches the law.
        with suppress(GoalError):
            self.goals.append((received, *messages.goal_of(message, self._frame_id)))

    def _read_path(self, _received: int, message: Any) -> None:
        # A robot at rest publishes a single pose, and that is no plan.
        if len(message.poses) != 1:
            poses = (each.pose for each in message.poses)
            self._paths[stamp_of(message)] = tuple(
                (each.position.x, each.position.y, each.orientation.z, each.orientation.w)
                for each in poses
            )

    def _read_change(self, received: int, message: Any) -> None:
        if (changed := changes_in(message, self._names.node)) is not None:
            self.changes.append((received, changed))

    def _note(self, received: int, tracks: Iterable[messages.MovingObject]) -> None:
        for each in tracks:
            at, known = self._tracks.pop(each.key, (received, each))
            # Where time has jumped back, the same instant comes again.
            is_again = received - at > SLACK
            self._tracks[each.key] = received, each if is_again else max(each, known)
        while len(self._tracks) > _MAX_TRACKS:
            del self._tracks[next(iter(self._tracks))]

    def _complete(self, decision: DecisionRecord) -> DecisionRecord:
        if self._first:
            # Commands whose decisions came before the recorder.
            while len(self._commands) > 1 and self._commands[1][0] < decision.received:
                self._commands.popleft()
            self._first = False
        # The clock may show the time of odometry that a plan is made on a moment later.
        path = None if decision.halted else self._paths.pop(decision.stamp, None)
        command = None
        if self._commands and self._commands[0][0] <= decision.received + _LATE:
            command = None if decision.late else self._commands.popleft()[1]
        return replace(decision, command=command, path=path)
