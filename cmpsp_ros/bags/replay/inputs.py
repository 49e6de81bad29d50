"""The inputs of a recorded guidance law in the order that its decisions imply, and their follower.

Odometry, goals, moving obstacles and plans of other robots are in the bag. Everything else is
recorded with each decision: stops by the node's clock, resets, live parameter changes, and which
goals, obstacles and plans had arrived by then (`halted`, `late`, `skipped`, `run`, `revision`,
`goals_received`, `moving_obstacles`), and `pose` if a transform was applied.
"""

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.bags.decision_record import DecisionRecord
from cmpsp_ros.bags.names import Names
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.bags.replay.recording import SLACK, NodeParameters, OdometrySample, Recording
from cmpsp_ros.guidance import Decision, Goal, GoalError, GuidanceLaw, GuidanceSettings, Observation
from cmpsp_ros.guidance.messages import MovingObject
from cmpsp_ros.parameters import Values
from cmpsp_ros.sensing import Sighting


@dataclass(frozen=True)
class RunStarted:
    """A law was created, with these parameters."""

    values: Values


@dataclass(frozen=True)
class ParametersChanged:
    """Parameters were changed live, to these."""

    values: Values


@dataclass(frozen=True)
class RunReset:
    """The run was restarted."""


@dataclass(frozen=True)
class GoalReceived:
    """A goal was received, with this stamp [ns]."""

    stamp: int
    goal: Goal


@dataclass(frozen=True)
class OdometryReceived:
    """Odometry was received, with its decision, if any, and the surroundings known then."""

    odometry: OdometrySample
    decision: DecisionRecord | None
    tracks: tuple[MovingObject, ...] = field(default=(), kw_only=True)
    sighting: Sighting | None = field(default=None, kw_only=True)


@dataclass(frozen=True)
class Halted:
    """The node stopped the robot without odometry."""

    decision: DecisionRecord


@dataclass(frozen=True)
class OdometryMissing:
    """A decision on odometry that is not in the bag."""

    decision: DecisionRecord


Input = (
    RunStarted
    | ParametersChanged
    | RunReset
    | GoalReceived
    | OdometryReceived
    | Halted
    | OdometryMissing
)


class Inputs:
    """The inputs of a recorded guidance law; can be iterated over once."""

    def __init__(self, bag: Bag, names: Names) -> None:
        self._bag, self._node = bag, names.node
        self._parameters = NodeParameters(bag, names.node)
        self.skipped = 0  # decisions before the first run in the bag: its law's state is unknown
        # After the last decision of a run that has not ended; without the last second, whose
        # decisions may come too late.
        self.remaining: list[OdometrySample] = []
        # False where the node had stopped, or may have refused some of it.
        self.goes_on = False
        values = self.values
        self._recording = Recording(bag, names, values['frame_id'], values['others.namespaces'])
        self._pose: Array | None = None

    @property
    def values(self) -> Values:
        """The parameters, after all changes read so far."""
        return self._parameters.values

    @property
    def given(self) -> frozenset[str]:
        """Keys of the recorded parameters; the others are defaults."""
        return self._parameters.given

    def __iter__(self) -> Iterator[Input]:
        """Iterate; raises `BagError` if the bag is damaged or lacks an input."""
        before: DecisionRecord | None = None
        recording = self._recording
        # False where some odometry since the last decision may have been refused.
        received_all = False
        for decision in recording.decisions():
            if before is None and decision.step > 0:
                self.skipped += 1
                continue
            # Another law decides where the node was configured or started again.
            begins = before is None or (
                decision.run < before.run
                or decision.revision < before.revision
                or (decision.run == before.run and decision.step < before.step)
            )
            odometry = None if decision.halted else self._find(decision)
            if odometry is not None and decision.pose is None:
                received_all = received_all and not begins and not decision.skipped
                yield from self._between(odometry, received_all=received_all)
            if before is None or begins:
                yield from self._began(decision, again=before is not None)
            else:
                yield from self._changes_between(before, decision)
            goals = self._goals(None if begins else before, decision)
            if odometry is None and not decision.halted:
                if not recording.odometry and recording.unusable:
                    raise self._bag.error(f'no usable odometry: {recording.unusable}')
                yield OdometryMissing(decision)
            else:
                yield from goals
            if decision.halted:
                yield Halted(decision)
            elif odometry is not None:
                tracks, sighting = recording.tracks(decision), recording.sighting(decision)
                yield OdometryReceived(odometry, decision, tracks=tracks, sighting=sighting)
            before, received_all = decision, not decision.halted and not decision.late
        if before is None:
            raise self._bag.error(
                f'found {self.skipped} decisions of {self._node}, wanted one'
                ' that begins a run (step 0): what a law knew before cannot be replayed'
            )
        waiting, stamp = recording.odometry, before.stamp
        until = waiting[-1].received - SLACK if waiting and not before.finished else 0
        self.remaining = [each for each in waiting if each.stamp > stamp and each.received < until]
        self.goes_on = received_all and before.pose is None

    def _find(self, decision: DecisionRecord) -> OdometrySample | None:
        stamp, before = decision.stamp, self._pose
        if decision.pose is not None:
            found = [OdometrySample(decision.received, stamp, np.array(decision.pose))]
        else:
            found = [each for each in self._recording.odometry if each.stamp == stamp]
        if before is not None:
            # Of two sources the node follows the one that does not jump.
            found.sort(key=lambda each: math.dist(each.pose[:2], before[:2]))
        self._pose = found[0].pose if found else before
        return found[0] if found else None

    def _between(self, wanted: OdometrySample, *, received_all: bool) -> Iterator[Input]:
        waiting = self._recording.odometry
        while (each := waiting.popleft()) is not wanted:
            # The node received newer odometry after the decision: it is of another source.
            if received_all and each.stamp < wanted.stamp:
                yield OdometryReceived(each, None)

    def _began(self, decision: DecisionRecord, *, again: bool) -> Iterator[Input]:
        began = 0
        while (since := self._parameters.restart(until=decision.received)) is not None:
            began = since
        while self._has_change(until=decision.received):
            self._change(used=again and not began, since=began)
        yield RunStarted(self.values)

    def _changes_between(self, before: DecisionRecord, decision: DecisionRecord) -> Iterator[Input]:
        for _ in range(decision.revision - before.revision):
            if not self._has_change():
                raise self._bag.error(
                    f'found a decision (stamp {decision.stamp}) after live'
                    f' change {decision.revision} of the parameters of {self._node}, wanted'
                    ' that change in /parameter_events'
                )
            self._change(used=True)
            yield ParametersChanged(self.values)
        if decision.run != before.run or decision.step < before.step:
            yield RunReset()

    def _goals(self, before: DecisionRecord | None, decision: DecisionRecord) -> list[GoalReceived]:
        """The goals that the law received since the decision before, or since a run began."""
        waiting, count = self._recording.goals, decision.goals_received
        if before is not None and decision.run == before.run and decision.step >= before.step:
            count -= before.goals_received
        else:
            # Goals from before the run began were ignored.
            come = sum(received <= decision.received for received, _, _ in waiting)
            for _ in range(come - count):
                waiting.popleft()
        if count > len(waiting):
            raise self._bag.error(
                f'found a decision (stamp {decision.stamp}) after'
                f' {decision.goals_received} goals, wanted all of them on goal_pose'
            )
        return [
            GoalReceived(stamp, goal)
            for _, stamp, goal in (waiting.popleft() for _ in range(count))
        ]

    def _has_change(self, until: int | None = None) -> bool:
        waiting = self._recording.changes
        return bool(waiting) and (until is None or waiting[0][0] <= until)

    def _change(self, *, used: bool, since: int = 0) -> None:
        received, changes = self._recording.changes.popleft()
        if received >= since:
            self._parameters.change(received, changes, used=used)


class Follower:
    """Feeds inputs to a law, which is created by the first of them."""

    law: GuidanceLaw

    def __init__(self, settings_of: Callable[[Values], GuidanceSettings]) -> None:
        self._settings_of = settings_of

    def follow(self, event: Input) -> Decision | None:
        """Process one input; return the resulting decision, if any. Raises any error of the law."""
        match event:
            case RunStarted(values):
                settings = self._settings_of(values)
                self.law = GuidanceLaw(settings, settings.world)
            case ParametersChanged(values):
                settings = self._settings_of(values)
                self.law.reconfigure(settings, settings.world)
            case RunReset():
                self.law.reset()
            case GoalReceived(stamp, goal):
                # A refusal is counted, as it was then.
                with suppress(GoalError):
                    self.law.set_goal(stamp, goal)
            case Halted(decision):
                names = 'finished', 'cancelled', 'braking'
                flags = {name: getattr(decision, name) for name in names}
                return self.law.halt(decision.stamp, decision.reason, **flags)
            case OdometryReceived(odometry, recorded, tracks=tracks, sighting=sighting):
                observation = Observation(odometry.stamp, odometry.pose, tracks, sighting)
                decided = self.law.step(observation)
                if decided is None:
                    return None
                late = 0.0 if recorded is None or decided.plan is None else recorded.late
                return self.law.after_step(late)
        return None
