"""Replay: recorded odometry through the guidance law, compared with the recorded decisions."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from cmpsp_ros.bags.custom_data import own_version, software_versions
from cmpsp_ros.bags.decision_record import DecisionRecord
from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.names import Names
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.bags.replay.comparison import Comparison, Difference
from cmpsp_ros.bags.replay.follower import Follower
from cmpsp_ros.bags.replay.inputs import (
    GoalReceived,
    Halted,
    Input,
    Inputs,
    OdometryMissing,
    OdometryReceived,
    ParametersChanged,
    RunReset,
    RunStarted,
)
from cmpsp_ros.guidance import Decision, GuidanceSettings
from cmpsp_ros.parameters import ParameterError, Values, guidance_settings

_OF_THIS_LAW: Final = ('solver.candidates', 'solver.initial_iterations')


@dataclass
class ReplayOutcome:
    """Result of a replay.

    Attributes:
        software: Software installed where the bag was recorded, by name.
        decisions: Decisions compared.
        stops: Of them, stops that odometry does not show; their reason is taken as recorded.
        commands: Of them, those whose command was recorded and compared too.
        plans: Of them, those whose plan was recorded and compared too.
        skipped: Decisions before the first run in the bag; they cannot be replayed.
        differing: Decisions that differ.
        differences: Total number of fields that differ.
        first: The first of them; None when there is none.
    """

    software: Mapping[str, str]
    decisions: int = 0
    stops: int = 0
    commands: int = 0
    plans: int = 0
    skipped: int = 0
    differing: int = 0
    differences: int = 0
    first: Difference | None = None

    def __str__(self) -> str:
        """Summary in a few lines."""
        lines = [f'identical: {self.decisions} decisions']
        if self.first is not None:
            lines = [
                str(self.first),
                f'different: {self.differences} fields in {self.differing} of'
                f' {self.decisions} decisions; the first of them is above',
            ]
        compared = f'compared too: {self.commands} commands, {self.plans} plans'
        lines.append(f'{compared}; {self.stops} stops by the clock taken as recorded')
        if self.skipped:
            lines.append(f'left out: {self.skipped} decisions of a run that began unrecorded')
        if self.first is not None:
            lines += [
                f'recorded with {name} {self.software.get(name, "unknown")}, replayed with {here}'
                for name, here in _installed().items()
                if self.software.get(name) != here
            ]
        return '\n'.join(lines)

    def add(self, recorded: DecisionRecord | None, differences: list[Difference]) -> None:
        """Count a decision and its differences."""
        if recorded is not None:
            self.decisions += 1
            self.stops += recorded.halted
            self.commands += recorded.command is not None
            self.plans += recorded.path is not None
        if differences:
            self.differing += 1
            self.differences += len(differences)
            self.first = self.first or differences[0]


def _installed() -> dict[str, str]:
    return {'cmpsp_ros': own_version(), **software_versions()}


def replay(path: Path, names: Names, tolerance: float | None = None) -> ReplayOutcome:
    """Replay a bag, and compare.

    Args:
        path: The bag.
        names: Names of the recorded node and its topics.
        tolerance: As in `Comparison`.

    Raises:
        BagError: Not a bag, or it does not hold what a replay needs.
    """

    def settings_of(values: Values) -> GuidanceSettings:
        try:
            return guidance_settings(values)
        except ParameterError as error:
            raise BagError(f'{path}: parameters of {names.node}: {error.problems[0]}') from error

    with Bag(path) as bag:
        inputs = Inputs(bag, names)
        settings_of(inputs.values)
        _refuse_another_law(path, names, inputs.given)
        outcome = ReplayOutcome({'cmpsp_ros': bag.version or 'unknown', **bag.software})
        follower, comparison = Follower(settings_of), Comparison(tolerance)
        for event in inputs:
            if isinstance(event, RunStarted | ParametersChanged | RunReset | GoalReceived):
                _prepare(event, follower, path)
                continue
            for recorded, differences in _compare(event, follower, comparison, outcome.decisions):
                outcome.add(recorded, differences)
        outcome.skipped = inputs.skipped
        return outcome


def _refuse_another_law(path: Path, names: Names, given: Collection[str]) -> None:
    """Refuse recordings of a law without these parameters: it decided differently."""
    missing = [key for key in _OF_THIS_LAW if key not in given]
    if missing:
        raise BagError(
            f'{path}: found no {missing[0]} among the parameters of {names.node}, wanted a'
            ' recording of a law that has it: the one before decided otherwise'
        )


def _compare(
    event: OdometryReceived | Halted | OdometryMissing,
    follower: Follower,
    comparison: Comparison,
    before: int,
) -> Iterator[tuple[DecisionRecord | None, list[Difference]]]:
    """Feed an input; returns the decision on it, if any, and its differences."""
    number = before + 1
    match event:
        case OdometryReceived(odometry, None):
            # It is not fed, so that what follows can still be compared.
            if follower.law.is_due(odometry.stamp):
                missing_decision = Difference(
                    number, odometry.stamp, 'decision', 'nothing', 'one is due'
                )
                yield None, [missing_decision]
        case OdometryMissing(recorded):
            text = 'nothing, for the odometry that it answers is not in the bag'
            yield recorded, [Difference(number, recorded.stamp, 'decision', 'one', text)]
        case OdometryReceived(_, DecisionRecord() as recorded) | Halted(recorded):
            decision = _decision(event, follower)
            if isinstance(decision, Decision):
                yield recorded, list(comparison.differences(number, recorded, decision))
            else:
                yield recorded, [Difference(number, recorded.stamp, 'decision', 'one', decision)]


def _prepare(event: Input, follower: Follower, path: Path) -> None:
    try:
        follower.follow(event)
    except BagError:
        raise
    except Exception as error:
        raise BagError(
            f'{path}: the parameters make no guidance law: {type(error).__name__}: {error}'
        ) from error


def _decision(event: Input, follower: Follower) -> Decision | str:
    """The decision on an input, or the reason that there is none."""
    try:
        return follower.follow(event) or 'nothing, for none is due'
    except BagError:
        raise
    except Exception as error:
        return f'{type(error).__name__}: {error}'
