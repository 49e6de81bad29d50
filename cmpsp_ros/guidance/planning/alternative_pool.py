"""The alternatives that are kept beside the plan followed, and the planners of all of them."""

from __future__ import annotations

from typing import NamedTuple

from cmpsp_ros.guidance.formulation.ocp_formulation import OcpFormulation
from cmpsp_ros.guidance.planning.candidate import Candidate
from cmpsp_ros.guidance.planning.homotopy.gaps import HomotopyClass
from cmpsp_ros.guidance.planning.planner import Planner
from cmpsp_ros.guidance.planning.ranking import Score

# Control steps for which an alternative may have a flaw, or cost more than the plan followed.
_PATIENCE = 5


class Alternative(NamedTuple):
    """A plan with the planner that improved it.

    Attributes:
        planner: Its own planner, which knows its active constraints.
        candidate: The plan, improved and audited.
        score: How good it is.
        homotopy_class: On which side it passes each obstacle.
        bad_steps: For how many control steps in a row it has had a flaw, or cost more than the
            plan followed.
    """

    planner: Planner
    candidate: Candidate
    score: Score
    homotopy_class: HomotopyClass
    bad_steps: int = 0


class AlternativePool:
    """One planner for the plan followed and for each alternative, and free ones.

    Attributes:
        followed: The planner of the plan that is followed.
        alternatives: What is kept beside it.
    """

    def __init__(self, formulation: OcpFormulation, count: int) -> None:
        """Make planners.

        Args:
            formulation: What all plans have in common.
            count: How many are free at first.
        """
        self._formulation = formulation
        self.followed = Planner(formulation)
        self.alternatives: list[Alternative] = []
        self._free = [Planner(formulation) for _ in range(count)]

    def forget(self) -> None:
        """Keep no alternative."""
        self._free += [each.planner for each in self.alternatives]
        self.alternatives = []

    def take(self) -> Planner:
        """A planner without a warm start."""
        planner = self._free.pop() if self._free else Planner(self._formulation)
        planner.forget()
        return planner

    def follow_better(self, planner: Planner, *, better: bool) -> None:
        """Follow the plan of another planner if it is better; the other one of both is free."""
        if better:
            self.followed, planner = planner, self.followed
        self._free.append(planner)

    def worth_improving(self, capacity: int) -> list[Alternative]:
        """Those that have not been worse for too long; of too many, the better ones first."""
        ordered = sorted(self.alternatives, key=lambda each: each.bad_steps)
        kept = [each for each in ordered[:capacity] if each.bad_steps <= _PATIENCE]
        self._free += [each.planner for each in ordered[len(kept) :]]
        return kept

    def keep(self, best: Alternative, every: list[Alternative], waiting: list[Alternative]) -> None:
        """Go on with one plan, and with the best of every other class that may yet be better.

        Args:
            best: The plan to follow.
            every: All that were improved.
            waiting: Those that there was no work left for.
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
        going_on = {id(each.planner) for each in (best, *self.alternatives)}
        self._free += [each.planner for each in every if id(each.planner) not in going_on]
        self.alternatives += [each._replace(bad_steps=each.bad_steps + 1) for each in waiting]
