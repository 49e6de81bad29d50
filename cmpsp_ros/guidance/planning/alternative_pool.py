"""Alternatives beside the plan that is followed, and the planners of all of them."""

from __future__ import annotations

from typing import Final, NamedTuple

from cmpsp_ros.guidance.formulation.ocp_formulation import OcpFormulation
from cmpsp_ros.guidance.planning.candidate import Candidate, Score
from cmpsp_ros.guidance.planning.homotopy.gaps import HomotopyClass
from cmpsp_ros.guidance.planning.planner import Planner

_PATIENCE: Final = 5
"""Control steps for which an alternative may have a flaw, or cost more than the plan followed."""


class Alternative(NamedTuple):
    """A plan with the planner that improved it.

    Attributes:
        planner: Its own planner, which knows its active constraints.
        candidate: The plan, improved and checked.
        score: Its score.
        homotopy_class: Side on which it passes each obstacle.
        bad_steps: Control steps in a row in which it had a flaw, or cost more than the plan
            followed.
    """

    planner: Planner
    candidate: Candidate
    score: Score
    homotopy_class: HomotopyClass
    bad_steps: int = 0


class AlternativePool:
    """Planners of the plan that is followed and of alternatives, and free ones.

    Attributes:
        followed: Planner of the plan that is followed.
        alternatives: Plans kept beside it.
        free: Planners that are not in use.
    """

    def __init__(self, formulation: OcpFormulation, count: int) -> None:
        """Make the planner that is followed and some free ones."""
        self._formulation = formulation
        self.followed = Planner(formulation)
        self.alternatives: list[Alternative] = []
        self.free = [Planner(formulation, self.followed.compiled) for _ in range(count)]

    def reformulate(self, formulation: OcpFormulation) -> None:
        """Take another formulation; alternatives were of the one before.

        With the same layout the planner that is followed keeps its warm start.
        """
        self.forget()
        known, self._formulation = self._formulation, formulation
        if formulation.layout != known.layout:
            self.followed, self.free = Planner(formulation, self.followed.compiled), []
            return
        for planner in (self.followed, *self.free):
            planner.reformulate(formulation)

    def forget(self) -> None:
        """Keep no alternative."""
        self.free += [each.planner for each in self.alternatives]
        self.alternatives = []

    def take(self) -> Planner:
        """A planner without a warm start."""
        if not self.free:
            self.free.append(Planner(self._formulation, self.followed.compiled))
        planner = self.free.pop()
        planner.forget()
        return planner

    def worth_improving(self, capacity: int) -> list[Alternative]:
        """Alternatives that have not been worse for too long, the better ones first."""
        ordered = sorted(self.alternatives, key=lambda each: each.bad_steps)
        kept = [each for each in ordered[:capacity] if each.bad_steps <= _PATIENCE]
        self.free += [each.planner for each in ordered[len(kept) :]]
        return kept

    def keep(self, best: Alternative, every: list[Alternative], waiting: list[Alternative]) -> None:
        """Follow one of the improved plans, and keep the best of other classes that may get better.

        Those that no work was left for wait.
        """
        kept = {best.homotopy_class: best}
        for each in every:
            other = kept.get(each.homotopy_class)
            if other is None or (other is not best and each.score.beats(other.score)):
                kept[each.homotopy_class] = each
        self.followed = best.planner
        self.alternatives = [
            each._replace(
                bad_steps=each.bad_steps + 1 if each.score.is_worse_than(best.score) else 0
            )
            for each in kept.values()
            if each is not best and not best.score.outclasses(each.score)
        ]
        used = {id(each.planner) for each in (best, *self.alternatives)}
        self.free += [each.planner for each in every if id(each.planner) not in used]
        self.alternatives += [each._replace(bad_steps=each.bad_steps + 1) for each in waiting]
