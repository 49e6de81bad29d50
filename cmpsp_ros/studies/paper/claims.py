"""The paper's claims compared with results, and the parts of the report that hold them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

from matplotlib.figure import Figure

from cmpsp_ros.studies.paper.drives import Laboratory


class Verdict(Enum):
    """Whether a claim holds."""

    HOLDS = 'holds'
    FAILS = 'does not hold'
    DEPENDS = 'depends'
    UNDECIDABLE = 'not decidable'

    @classmethod
    def of(cls, holds: bool) -> Verdict:
        """The verdict on something measured that is either so or not."""
        return cls.HOLDS if holds else cls.FAILS


@dataclass(frozen=True)
class Claim:
    """One row of the report.

    Attributes:
        where: Section, figure or equation of the paper.
        says: Its words or number.
        found: The result found here.
        verdict: Whether the two agree.
        reason: The reason for the verdict.
    """

    where: str
    says: str
    found: str
    verdict: Verdict
    reason: str


@dataclass(frozen=True)
class Table:
    """A table of the report: a heading, the columns' names and rows of text."""

    heading: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]


@dataclass(frozen=True)
class Artefact:
    """A figure or table of the paper, reproduced.

    Attributes:
        title: What it shows, in a sentence.
        numbers: Everything in it, for `results.json`.
        claims: The paper's claims about it.
        figure: The picture; None for a table.
        tables: Tables for the report.
    """

    title: str
    numbers: dict[str, Any]
    claims: Sequence[Claim] = ()
    figure: Figure | None = None
    tables: Sequence[Table] = field(default_factory=tuple)


Maker = Callable[[Laboratory], Artefact]
