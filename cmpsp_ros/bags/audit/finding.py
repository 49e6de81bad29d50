"""Results of the checks of an audit."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any


class CheckOutcome(Enum):
    """How a check ended."""

    PASSED = 'passed'
    FAILED = 'failed'
    SKIPPED = 'skipped'


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
    """No verdict, and why."""
    return Verdict(outcome=CheckOutcome.SKIPPED, sentence=reason)
