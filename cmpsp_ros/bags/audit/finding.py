"""Results of the checks of an audit."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any


class CheckOutcome(Enum):
    """Outcome of a check.

    A check is skipped where it does not apply, and not judged where it applies and data that it
    needs are missing.
    """

    PASSED = 'passed'
    FAILED = 'failed'
    SKIPPED = 'skipped'
    NOT_JUDGED = 'not judged'


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Result of a check.

    Attributes:
        outcome: How it ended.
        sentence: What was found, or why the check was impossible.
        worst: The worst value; None where there is none.
        limit: Its limit, in the same unit.
        unit: Their unit.
        at: Time of the worst value, from time 0 of the first run [s].
    """

    outcome: CheckOutcome
    sentence: str
    worst: float | None = None
    limit: float | None = None
    unit: str = ''
    at: float | None = None

    @property
    def worst_text(self) -> str:
        """The worst value with its unit, empty where there is none."""
        return self._text(self.worst)

    @property
    def limit_text(self) -> str:
        """The limit with its unit, empty where there is none."""
        return self._text(self.limit)

    def _text(self, value: float | None) -> str:
        return '' if value is None else f'{value:.4g} {self.unit}'.rstrip()


@dataclass(frozen=True, kw_only=True)
class Finding(Verdict):
    """A verdict with the name of its check.

    Attributes:
        check: Short name, for machines.
        title: What was checked, for people.
    """

    check: str
    title: str


def passed_if(passed: bool, sentence: str, **figures: Any) -> Verdict:
    """A verdict; `figures` as in `Verdict`."""
    outcome = CheckOutcome.PASSED if passed else CheckOutcome.FAILED
    return Verdict(outcome=outcome, sentence=sentence, **figures)


def skipped(reason: str) -> Verdict:
    """The verdict of a check that does not apply, and why."""
    return Verdict(outcome=CheckOutcome.SKIPPED, sentence=reason)


def not_judged(reason: str) -> Verdict:
    """The verdict of a check whose data are missing: which."""
    return Verdict(outcome=CheckOutcome.NOT_JUDGED, sentence=reason)


def unless(verdict: Verdict, missing: str) -> Verdict:
    """A verdict that is not passed if data are missing: a sentence on them, or empty."""
    if not missing:
        return verdict
    outcome = verdict.outcome
    if outcome is CheckOutcome.PASSED:
        outcome = CheckOutcome.NOT_JUDGED
    return replace(verdict, outcome=outcome, sentence=f'{verdict.sentence} {missing}')


def overall(findings: Iterable[Finding]) -> CheckOutcome:
    """Outcome of an audit: failed if any check failed, else not judged if any was not."""
    outcomes = {each.outcome for each in findings}
    worst_first = CheckOutcome.FAILED, CheckOutcome.NOT_JUDGED, CheckOutcome.PASSED
    return next(each for each in worst_first if each in outcomes)
