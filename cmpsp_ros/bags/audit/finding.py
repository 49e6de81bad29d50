"""Skeleton of a check: its declaration, its samples, and the finding that follows from them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.parameters import road_keys

if TYPE_CHECKING:
    from cmpsp_ros.bags.audit.record import AuditRecord

OUT_OF_REACH: Final = 1e3  # clearance from which on nothing is within reach [m]
NOTHING_NEAR: Final = 'No road edge and no obstacle is within reach.'


class CheckOutcome(Enum):
    """Outcome of a check: skipped where it does not apply, not judged where data are missing."""

    PASSED = 'passed'
    FAILED = 'failed'
    SKIPPED = 'skipped'
    NOT_JUDGED = 'not judged'


@dataclass(frozen=True, kw_only=True)
class Finding:
    """Result of a check, or why it was impossible, in a sentence and by the worst value."""

    check: str
    title: str
    outcome: CheckOutcome
    sentence: str
    worst: float | None = None
    limit: float | None = None
    unit: str = ''  # of worst value and limit
    at: float | None = None  # time of the worst value, from time 0 of the first run [s]

    @property
    def worst_text(self) -> str:
        """The worst value with its unit, '' if none."""
        return self._text(self.worst)

    @property
    def limit_text(self) -> str:
        """The limit with its unit, '' if none."""
        return self._text(self.limit)

    def _text(self, value: float | None) -> str:
        return '' if value is None else f'{round(value, 6):.4g} {self.unit}'.rstrip()


def overall(findings: Iterable[Finding]) -> CheckOutcome:
    """Outcome of an audit: failed if any check failed, else not judged if any was not."""
    outcomes = {each.outcome for each in findings}
    worst_first = CheckOutcome.FAILED, CheckOutcome.NOT_JUDGED, CheckOutcome.PASSED
    return next(each for each in worst_first if each in outcomes)


class SkippedError(Exception):
    """The check does not apply: why."""


class NothingMetError(Exception):
    """Nothing that was recorded can be judged: why; the check is skipped unless it has gaps."""


class NotJudgedError(Exception):
    """The check applies, and data that it needs are missing: which."""


@dataclass(frozen=True)
class Sample:
    """One value that a check looks at, with its limit, at a time [ns] if it has one."""

    value: float
    limit: float
    at: int | None
    excess: float  # the check fails if it is above 0, or NaN
    # The largest is the worst, of those that fail if there are any; by default `excess`.
    rank: float | None = None
    unit: str = ''  # in place of the check's
    words: Mapping[str, Any] = field(default_factory=dict)  # for the sentence

    @classmethod
    def upper(cls, value: float, limit: float, at: int) -> Sample:
        """A value that is to be at most its limit."""
        return cls(value, limit, at, value - limit)

    @classmethod
    def count(cls, count: int, at: int | None, **words: Any) -> Sample:
        """Number of wrong values, with the time of the first."""
        return cls(float(count), 0.0, at if count else None, float(count), words=words)

    @classmethod
    def largest(
        cls, values: Array, limits: Array | float, stamps: IntArray, excess: Array
    ) -> Sample:
        """The one of the largest excess, NaN first."""
        k = int(np.argmax(excess))
        limit = np.broadcast_to(limits, values.shape)[k]
        return cls(float(values[k]), float(limit), int(stamps[k]), float(excess[k]))

    @property
    def passes(self) -> bool:
        """False if it fails the check."""
        return self.excess <= 0.0

    @property
    def order(self) -> tuple[bool, float]:
        """Key of the worst."""
        rank = self.excess if self.rank is None else self.rank
        return not self.passes, math.inf if math.isnan(rank) else rank


Gap = Callable[['AuditRecord', Sample], str]


@dataclass(frozen=True, kw_only=True)
class Check:
    """Declaration of a check."""

    name: str  # short name, for machines
    title: str  # name for people
    # Yields samples; raises `SkippedError` or `NotJudgedError`.
    samples: Callable[[AuditRecord], Iterator[Sample]]
    # Parameters without which it cannot be judged; `road` stands for those of a road.
    needs: tuple[str, ...] = ()
    of_decisions: bool = False  # needs decisions
    unit: str = ''  # of its values
    # Sentence where it passes, with ``{worst}`` and the words of the worst sample.
    good: str | Callable[[Sample], str] = ''
    bad: str | Callable[[Sample], str] = ''  # the same where it fails
    nothing: str = ''  # reason to skip it where there is no sample and no gap
    # Each a sentence on missing data, or empty; with any of them it does not pass.
    gaps: tuple[Gap, ...] = ()
    of_reach: bool = False  # its values are clearances, infinite where nothing is near

    def judge(self, record: AuditRecord) -> Finding:
        """The finding on the worst sample."""
        worst, nothing = None, self.nothing
        try:
            self._check_data(record)
            worst = max(self.samples(record), key=lambda each: each.order, default=None)
        except NothingMetError as reason:
            nothing = str(reason)
        except SkippedError as reason:
            return self._finding(CheckOutcome.SKIPPED, str(reason))
        except NotJudgedError as reason:
            return self._finding(CheckOutcome.NOT_JUDGED, str(reason))
        looked_at = worst or Sample(math.nan, math.nan, None, math.nan)
        missing = [said for each in self.gaps if (said := each(record, looked_at))]
        if worst is None:
            outcome = CheckOutcome.NOT_JUDGED if missing else CheckOutcome.SKIPPED
            return self._finding(outcome, ' '.join(missing) or nothing)
        outcome = CheckOutcome.PASSED if worst.passes else CheckOutcome.FAILED
        if missing and worst.passes:
            outcome = CheckOutcome.NOT_JUDGED
        if self.of_reach and worst.value >= OUT_OF_REACH:
            return self._finding(outcome, ' '.join([NOTHING_NEAR, *missing]))
        form = self.good if worst.passes else self.bad
        said = form(worst) if callable(form) else form.format(worst=worst.value, **worst.words)
        return self._finding(
            outcome,
            ' '.join([said, *missing]),
            worst=worst.value,
            limit=worst.limit,
            unit=worst.unit or self.unit,
            at=None if worst.at is None else record.seconds(worst.at),
        )

    def _check_data(self, record: AuditRecord) -> None:
        values = record.history.epochs[0].values
        needs = (road_keys(values) if key == 'road' else [key] for key in self.needs)
        if missing := [key for keys in needs for key in keys if key not in record.history.given]:
            raise NotJudgedError(f'The parameters do not say {", ".join(missing)}.')
        if self.of_decisions and not record.decisions:
            reason = f'The bag has no decision in {record.places.decision}.'
            # Another robot makes none.
            raise NotJudgedError(reason) if record.is_ours else SkippedError(reason)

    def _finding(self, outcome: CheckOutcome, sentence: str, **figures: Any) -> Finding:
        named: dict[str, Any] = {'check': self.name, 'title': self.title, **figures}
        return Finding(outcome=outcome, sentence=sentence, **named)


def check(name: str, title: str, **declared: Any) -> Callable[[Any], Check]:
    """Declare a check whose samples a function yields; arguments as of `Check`."""
    return lambda samples: Check(name=name, title=title, samples=samples, **declared)
