"""What the guidance node received and published, read from its bag in one pass."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

from cmpsp_ros.arrays import Array
from cmpsp_ros.bags.decision_record import DecisionRecord, Waypoint
from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.names import Names
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.bags.replay.node_parameters import EVENTS, changes_in
from cmpsp_ros.guidance import Goal, GoalError
from cmpsp_ros.guidance.messages import (
    MovingObject,
    OdometryError,
    OdometryReading,
    PeerTrajectory,
    TrackError,
    goal_of,
    tracks_of,
)
from cmpsp_ros.sensing import Sighting, grid_of, stamp_of

_SLACK = 1_000_000_000
"""By how much messages that belong together may lie apart in a bag [ns]."""

_LATE = 50_000_000
"""By how much a command may come into the bag after its decision [ns]."""

_MOST = 10_000
"""Messages of a topic that are kept: more than any robot sends in `_SLACK`."""

_MOST_TRACKS = 100_000
"""Sightings of obstacles that move, of all of them, that are kept."""


@dataclass(frozen=True)
class OdometrySample:
    """Odometry on which a decision can be made.

    Attributes:
        received: Time of reception by the recorder [ns].
        stamp: Its own time stamp [ns].
        pose: Pose, shape ``(3,)`` [m, m, rad].
    """

    received: int
    stamp: int
    pose: Array


class Recording:
    """The messages of one guidance node, each kept only as long as it may be needed.

    Attributes:
        odometry: Read and not yet used, in order.
        unusable: Why the first invalid odometry is invalid; empty if there was none.
        changes: Time of reception [ns] and content of live parameter changes not yet used, in
            order.
        goals: Time of reception and stamp [ns] of goals not yet used, in order.
    """

    def __init__(self, bag: Bag, names: Names, frame_id: str, others: Iterable[str] = ()) -> None:
        """Check that the bag has the inputs and outputs of a guidance node.

        Args:
            bag: An open bag.
            names: Names of node and topics.
            frame_id: Frame in which odometry is usable.
            others: Namespaces of the robots whose plans it receives.

        Raises:
            BagError: A topic is missing.
        """
        self._others = names.others(others)
        # Of a node that says which goals it has heard these are all, and in its own frame.
        self._goal_pose = bag.as_decided_on(names.node, 'goal_pose')
        self._moving = names.moving, f'{names.node}/moving_obstacles'
        optional = (
            EVENTS,
            names.cmd_vel,
            names.path,
            *self._moving,
            names.sighting,
            self._goal_pose,
            *self._others,
        )
        self._bag, self._names, self._frame_id = bag, names, frame_id
        there = (topic for topic in optional if topic in bag.topics)
        self._topics = [names.odom, names.decision, *there]
        self.odometry: deque[OdometrySample] = deque(maxlen=_MOST)
        self.unusable = ''
        self.changes: deque[tuple[int, dict[str, Any]]] = deque()
        self.goals: deque[tuple[int, int, Goal]] = deque(maxlen=_MOST)
        self._commands: deque[tuple[int, tuple[float, float, float]]] = deque(maxlen=_MOST)
        self._paths: dict[int, tuple[Waypoint, ...]] = {}
        self._tracks: dict[tuple[int | str, int], MovingObject] = {}
        self._sightings: dict[int, Sighting] = {}
        self._first = True

    def decisions(self) -> Iterator[DecisionRecord]:
        """Iterate over the decisions; odometry and changes are read ahead of each.

        Raises:
            BagError: The bag is damaged, or no recording of a guidance node.
        """
        pending: deque[DecisionRecord] = deque()
        for topic, received, message in self._bag.together(self._topics):
            while pending and received > pending[0].received + _SLACK:
                yield self._complete(pending.popleft())
            if topic == self._names.decision:
                pending.append(DecisionRecord.of(f'{self._bag.path}: {topic}', received, message))
            else:
                try:
                    self._take(topic, received, message)
                except (AttributeError, TypeError, ValueError) as error:
                    raise BagError(
                        f'{self._bag.path}: {topic}: found a message that is none of its type at'
                        f' {received} ns: {error}'
                    ) from error
            if max(len(pending), len(self._paths), len(self.changes)) > _MOST:
                raise BagError(f'{self._bag.path}: found over {_MOST} decisions within a second')
        while pending:
            yield self._complete(pending.popleft())

    def tracks(self, decision: DecisionRecord) -> tuple[MovingObject, ...]:
        """Obstacles that move, and plans of other robots, as they were known to a decision.

        Raises:
            BagError: One of them is not in the bag.
        """
        for number, stamp in decision.tracks:
            if (number, stamp) not in self._tracks:
                what, topic = f'obstacle {number} as it was seen', self._names.moving
                if isinstance(number, str):
                    what, topic = f'the plan that {number} made', PeerTrajectory.topic(number)
                raise BagError(
                    f'{self._bag.path}: found a decision (stamp {decision.stamp}) on {what} at'
                    f' {stamp} ns, wanted that in {topic}'
                )
        return tuple(self._tracks[key] for key in decision.tracks)

    def sighting(self, decision: DecisionRecord) -> Sighting | None:
        """What was known of the surroundings to a decision.

        Raises:
            BagError: It is not in the bag.
        """
        stamp = decision.sighting
        if stamp is None:
            return None
        for older in [each for each in self._sightings if each < stamp]:
            del self._sightings[older]
        if stamp not in self._sightings:
            raise BagError(
                f'{self._bag.path}: found a decision (stamp {decision.stamp}) on what was seen at'
                f' {stamp} ns, wanted that in {self._names.sighting}'
            )
        return self._sightings[stamp]

    def _take(self, topic: str, received: int, message: Any) -> None:
        if topic == self._names.odom:
            try:
                pose = OdometryReading.of(message).pose_in(self._frame_id)
            except OdometryError as error:
                self.unusable = self.unusable or str(error)
            else:
                self.odometry.append(OdometrySample(received, stamp_of(message), pose))
        elif topic == self._names.cmd_vel:
            twist = getattr(message, 'twist', message)
            command = twist.linear.x, twist.linear.y, twist.angular.z
            self._commands.append((received, command))
        elif topic in self._moving:
            with suppress(TrackError):
                self._note(tracks_of(message, self._frame_id))
        elif topic == self._names.sighting:
            stamp = stamp_of(message)
            self._sightings[stamp] = Sighting(stamp, grid_of(message, self._frame_id))
        elif topic in self._others:
            with suppress(TrackError):
                self._note([PeerTrajectory.of(message, self._others[topic], self._frame_id)])
        elif topic == self._goal_pose:
            # What the node refuses at sight never reaches the law.
            with suppress(GoalError):
                self.goals.append((received, *goal_of(message, self._frame_id)))
        elif topic == self._names.path:
            poses = [each.pose for each in message.poses]
            # A robot that stands says so with one pose, and that is no plan.
            if len(poses) != 1:
                self._paths[stamp_of(message)] = tuple(
                    (each.position.x, each.position.y, each.orientation.z, each.orientation.w)
                    for each in poses
                )
        elif (changed := changes_in(message, self._names.node)) is not None:
            self.changes.append((received, changed))

    def _note(self, tracks: Iterable[MovingObject]) -> None:
        """Keep a received message; the node refused invalid ones, too."""
        for each in tracks:
            self._tracks[each.key] = max(each, self._tracks.get(each.key, each))
        while len(self._tracks) > _MOST_TRACKS:
            del self._tracks[next(iter(self._tracks))]

    def _complete(self, decision: DecisionRecord) -> DecisionRecord:
        if self._first:
            # Commands whose decisions the recorder came too late for.
            while len(self._commands) > 1 and self._commands[1][0] < decision.received:
                self._commands.popleft()
            self._first = False
        # The clock may show the time of odometry that a plan is made on a moment later.
        path = None if decision.halted else self._paths.pop(decision.stamp, None)
        return replace(decision, command=self._command_of(decision), path=path)

    def _command_of(self, decision: DecisionRecord) -> tuple[float, float, float] | None:
        """The command sent just before a decision was published."""
        if decision.late or not self._commands or self._commands[0][0] > decision.received + _LATE:
            return None
        return self._commands.popleft()[1]
