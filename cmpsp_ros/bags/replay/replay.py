"""Replay: recorded odometry through the guidance law, compared with the recorded decisions."""

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from cmpsp_ros.bags.custom_data import own_version, software_versions
from cmpsp_ros.bags.decision_record import DecisionRecord
from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.names import Names
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.bags.replay.inputs import (
    Follower,
    Halted,
    Input,
    Inputs,
    OdometryMissing,
    OdometryReceived,
)
from cmpsp_ros.guidance import (
    FIELDS,
    NANOSECONDS,
    Decision,
    GuidanceSettings,
    decision_to_key_values,
    waypoints,
)
from cmpsp_ros.parameters import ParameterError, Values, guidance_settings
from cmpsp_ros.robots.motion import with_side

_OF_THIS_LAW: Final = ('solver.candidates', 'solver.initial_iterations')


Pairs = Iterator[tuple[str, str | None, str | None]]

_COMPARED = [key for each in FIELDS.values() if not each.is_input for key in each.keys]

_NUMBER = re.compile(r'-?\d+(\.\d+)?(e[+-]?\d+)?')
_FRACTION = re.compile(r'-?(\d+\.\d+(e[+-]?\d+)?|\d+e[+-]?\d+|inf|nan)')


@dataclass(frozen=True)
class Difference:
    """A field that differs, of the decision of a number, from 1, on odometry of a stamp [ns]."""

    number: int
    stamp: int
    field: str
    recorded: str
    replayed: str

    def __str__(self) -> str:
        return (
            f'decision {self.number} (stamp {self.stamp} ns): {self.field}:'
            f' recorded {self.recorded}, replayed {self.replayed}'
        )


def differences(
    number: int, recorded: DecisionRecord, decision: Decision, tolerance: float | None = None
) -> Iterator[Difference]:
    """Fields that differ in a bit, computing times excepted.

    With a tolerance, which is absolute below 1: floats that differ by more.
    """
    for field, one, other in _pairs(recorded, decision):
        if one != other and not _close(field, one, other, tolerance):
            yield Difference(number, recorded.stamp, field, one or 'nothing', other or 'nothing')


def _close(field: str, recorded: str | None, replayed: str | None, tolerance: float | None) -> bool:
    if tolerance is None or recorded is None or replayed is None:
        return False
    if field == 'reason':
        return _NUMBER.sub('#', recorded) == _NUMBER.sub('#', replayed)
    # The speeds of four wheels are one text.
    ones, others = recorded.split(' '), replayed.split(' ')
    if len(ones) != len(others) or not all(map(_FRACTION.fullmatch, ones + others)):
        return False
    return all(
        math.isclose(float(one), float(other), rel_tol=tolerance, abs_tol=tolerance)
        for one, other in zip(ones, others, strict=True)
    )


def _pairs(recorded: DecisionRecord, decision: Decision) -> Pairs:
    now = decision_to_key_values(decision)
    for key in _COMPARED:
        yield key, recorded.entries.get(key), now.get(key)
    yield 'reason', recorded.reason, decision.reason
    if recorded.command is not None:
        names = ('command.linear.x', 'command.linear.y', 'command.angular.z')
        twist = with_side(decision.twist).tolist()
        for name, one, other in zip(names, recorded.command, twist, strict=True):
            yield name, repr(one), repr(other)
    if recorded.path is not None:
        yield from _waypoint_pairs(recorded, decision)


def _waypoint_pairs(recorded: DecisionRecord, decision: Decision) -> Pairs:
    path, plan = recorded.path or (), decision.plan
    points = () if plan is None else waypoints(plan)
    yield 'plan.poses', str(len(path)), str(len(points))
    # Waypoints are mostly equal, and many.
    if tuple(points) == path:
        return
    for index, (one, other) in enumerate(zip(path, points, strict=False)):
        for name, first, second in zip(('x', 'y', 'turn.z', 'turn.w'), one, other, strict=True):
            yield f'plan.poses[{index}].{name}', repr(first), repr(second)


@dataclass
class ReplayOutcome:
    """Counts of decisions compared, and of fields that differ; recording software by name."""

    software: Mapping[str, str]
    tolerance: float | None = None  # of floats; None where every bit counts
    decisions: int = 0
    stops: int = 0  # stops that odometry does not show; their reason is taken as recorded
    commands: int = 0  # decisions whose command was recorded and compared too
    plans: int = 0  # decisions whose plan was recorded and compared too
    skipped: int = 0  # decisions before the first run in the bag, which cannot be replayed
    unjudged: float = 0.0  # time after the last decision, in which another may have been due [s]
    differing: int = 0  # decisions that differ
    differences: int = 0
    is_incomplete: bool = False  # true if decisions that were due are missing
    first: Difference | None = None

    def __str__(self) -> str:
        verdict = 'identical'
        if self.tolerance is not None:
            verdict = f'within {self.tolerance:g}, but for numbers in reasons'
        lines = [f'{verdict}: {self.decisions} decisions']
        if self.first is not None:
            found = f'{self.differences} fields in {self.differing} of {self.decisions} decisions'
            if self.is_incomplete:
                found += ', and decisions that were due are missing'
            lines = [str(self.first), f'different: {found}; the first of them is above']
        compared = f'compared too: {self.commands} commands, {self.plans} plans'
        lines.append(f'{compared}; {self.stops} stops by the clock taken as recorded')
        if self.skipped:
            lines.append(f'left out: {self.skipped} decisions of a run that began unrecorded')
        if self.unjudged:
            span = f'{self.unjudged:.1f} s of odometry after the last decision'
            lines.append(f'not judged: {span}: another may have been due')
        if self.first is not None:
            installed = {'cmpsp_ros': own_version(), **software_versions()}
            lines += [
                f'recorded with {name} {self.software.get(name, "unknown")}, replayed with {here}'
                for name, here in installed.items()
                if self.software.get(name) != here
            ]
        return '\n'.join(lines)

    def add(self, recorded: DecisionRecord | None, differences: list[Difference]) -> None:
        """Count a decision and its differences."""
        if recorded is None:
            self.is_incomplete = True
        else:
            self.decisions += 1
            self.stops += recorded.halted
            self.commands += recorded.command is not None
            self.plans += recorded.path is not None
            self.differing += bool(differences)
            self.differences += len(differences)
        self.first = self.first or next(iter(differences), None)


def replay(path: Path, names: Names, tolerance: float | None = None) -> ReplayOutcome:
    """Replay a bag and compare, with a tolerance as in `differences`; raises BagError."""

    def settings_of(values: Values) -> GuidanceSettings:
        try:
            return guidance_settings(values)
        except ParameterError as error:
            raise bag.error(f'parameters of {names.node}: {error.problems[0]}') from error

    with Bag(path) as bag:
        inputs = Inputs(bag, names)
        settings_of(inputs.values)
        # A law without these parameters decided differently.
        if missing := [key for key in _OF_THIS_LAW if key not in inputs.given]:
            raise bag.error(
                f'found no {missing[0]} among the parameters of {names.node}, wanted a'
                ' recording of a law that has it: the one before decided otherwise'
            )
        software = {'cmpsp_ros': bag.version or 'unknown', **bag.software}
        outcome = ReplayOutcome(software, tolerance)
        follower = Follower(settings_of)
        for event in inputs:
            try:
                _take(event, follower, tolerance, outcome)
            except BagError:
                raise
            except Exception as error:
                said = f'the parameters make no guidance law: {type(error).__name__}: {error}'
                raise bag.error(said) from error
        outcome.skipped = inputs.skipped
        due = [each for each in inputs.remaining if follower.law.is_due(each.stamp)]
        if due and inputs.goes_on:
            _take(OdometryReceived(due[0], None), follower, tolerance, outcome)
        elif due:
            outcome.unjudged = (due[-1].stamp - due[0].stamp) / NANOSECONDS
        return outcome


def _take(
    event: Input, follower: Follower, tolerance: float | None, outcome: ReplayOutcome
) -> None:
    number = outcome.decisions + 1
    match event:
        case OdometryReceived(odometry, None):
            # It is not fed, so that later decisions can still be compared.
            if follower.law.is_due(odometry.stamp):
                due = Difference(number, odometry.stamp, 'decision', 'nothing', 'one is due')
                outcome.add(None, [due])
        case OdometryMissing(recorded):
            text = 'nothing, for the odometry that it answers is not in the bag'
            outcome.add(recorded, [Difference(number, recorded.stamp, 'decision', 'one', text)])
        case OdometryReceived(_, DecisionRecord() as recorded) | Halted(recorded):
            try:
                decision: Decision | str = follower.follow(event) or 'nothing, for none is due'
            except BagError:
                raise
            except Exception as error:
                decision = f'{type(error).__name__}: {error}'
            if isinstance(decision, Decision):
                found = list(differences(number, recorded, decision, tolerance))
            else:
                found = [Difference(number, recorded.stamp, 'decision', 'one', decision)]
            outcome.add(recorded, found)
        case _:
            follower.follow(event)
