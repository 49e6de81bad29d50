"""Selection among several plans: the one that is followed, alternatives of a pool, and new ones."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.formulation.ocp_formulation import OcpFormulation
from cmpsp_ros.guidance.planning.candidate import Candidate, Ranking, Score
from cmpsp_ros.guidance.planning.homotopy.gaps import HomotopyClass
from cmpsp_ros.guidance.planning.homotopy.path_search import class_of, in_words
from cmpsp_ros.guidance.planning.planner import Planner
from cmpsp_ros.guidance.planning.planning_context import Guesses, PlanningContext
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.world import MAP, SEEN, World
from cmpsp_ros.world import FreeSpace

if TYPE_CHECKING:
    from cmpsp_ros.guidance.planning.plan_selector import Improver

_GRIDS: Final = {SEEN: 'what is seen', MAP: 'the map'}  # names in messages
_PATIENCE: Final = 5  # control steps for which an alternative may be worse than the plan followed
_MUCH: Final = 16  # multiple of the work of a plan without a flaw that another may take from rest


class Alternative(NamedTuple):
    """A plan with the planner that improved it."""

    planner: Planner  # its own planner, which knows its active constraints
    candidate: Candidate  # the plan, improved and checked
    score: Score
    homotopy_class: HomotopyClass  # side on which it passes each obstacle
    bad_steps: int = 0  # number of control steps in a row in which it was worse than that followed


class AlternativePool:
    """Planners of the plan that is followed and of alternatives, and free ones."""

    def __init__(self, formulation: OcpFormulation, count: int) -> None:
        self._formulation = formulation
        self.followed = Planner(formulation)
        self.alternatives: list[Alternative] = []
        self.free = [Planner(formulation, self.followed.compiled) for _ in range(count)]

    def reformulate(self, formulation: OcpFormulation) -> None:
        """Take another formulation; with the same layout the plan followed keeps its warm start."""
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
        """Follow the best plan; keep the best of other classes, and those without work left."""
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


class Selection:
    """Improves alternatives, makes new ones, and selects the best of `limit` plans."""

    def __init__(self, formulation: OcpFormulation, improver: Improver) -> None:
        self._improver = improver
        self.take(formulation.settings)
        self.pool = AlternativePool(formulation, max(1, self.limit - 1))
        self.guesses = Guesses(formulation, self.limit)
        self.use(formulation.world)
        # Road coordinates of all obstacles in the control step.
        self._places = np.empty(0), np.empty(0)
        self.remark = ''  # sentence on which of how many plans was selected last

    def take(self, settings: LawSettings) -> None:
        """Take other settings."""
        # A road without end has no goal that guide paths could lead to.
        self.limit = settings.solver.candidates if settings.follow is None else 1
        self.ranking = Ranking(settings, compares=self.limit > 1)

    def reformulate(self, formulation: OcpFormulation) -> None:
        """Take another formulation; alternatives were of the one before."""
        self.guesses = Guesses(formulation, self.limit)
        self.use(formulation.world)
        self.pool.reformulate(formulation)

    def use(self, world: World) -> None:
        """Take the obstacles of a world."""
        self._world = world
        self._space = FreeSpace.of(world.road, world.shapes, 0.0)

    def only(self, warm: Candidate, context: PlanningContext) -> Candidate:
        """The only plan; if it has a flaw, the best of it, the centre line, and rest."""
        if warm.feasible or self._improver.work_left <= 0:
            return warm
        best = self._better(warm, context.center_line_guess, context)
        if best.admissible or not context.at_rest:
            return best
        return self._better(best, context.zero_controls, context)

    def best(
        self,
        warm: Candidate,
        context: PlanningContext,
        first: list[Array] | None,
        *,
        review: bool,
        may_change: bool,
    ) -> tuple[Candidate, bool]:
        """Improve alternatives, make new ones in a review; the best, and true if it is another.

        `warm` is the plan followed until now, `first` are guesses of a step that begins without.
        """
        centers = [self._space.centers, context.encounters.centers, self._space.islands]
        self._places = context.road_frame.coordinates(np.concatenate(centers))
        followed = self._scored(self.pool.followed, warm, context)
        # A new plan must fit in beside those that are known.
        capacity = self.limit - 2 if review else self.limit - 1
        improved, waiting = [], []
        for each in self.pool.worth_improving(capacity):
            if self._improver.work_left > 0:
                guess = self._improver.guess_from(each.candidate.plan, context)
                improved.append(self._improved(each.planner, guess, context, each.bad_steps))
            else:
                waiting.append(each)
        if review:
            improved += self._new_alternatives([followed, *improved], context, first)
        best = followed
        if may_change:
            for each in improved:
                best = each if each.score.beats(best.score) else best
        changed = best is not followed
        self.pool.keep(best, [followed, *improved], waiting)
        if improved:
            words = in_words(best.homotopy_class, self._obstacle_names(context))
            verb = 'Changed over to' if changed and not context.at_rest else 'It is'
            sides = f'{1 + len(improved)} plans{", " if words else ""}{words}'
            self.remark = f' {verb} the best of {sides}.'
        return best.candidate, changed

    def _new_alternatives(
        self, known: list[Alternative], context: PlanningContext, guesses: list[Array] | None
    ) -> list[Alternative]:
        """New plans; without guesses, of homotopy classes that no plan without a flaw has yet."""
        timed, tried = self._improver.timed, guesses or []
        found: list[Alternative] = []
        if guesses is not None:
            # A class that takes many times the work is closed, or too narrow.
            works = (each.candidate.result.work for each in known if not each.score.flawed)
            most_work = _MUCH * min(works, default=0)
            found = self._made_from(guesses[1:], context, most_work or None)
        elif self._improver.work_left > 0:
            taken = {each.homotopy_class for each in known if not each.score.flawed}
            capacity = self.limit - len(known)
            fresh = timed('solve', self.guesses.fresh, context, capacity, taken)
            found = self._made_from(fresh[:capacity], context)
        every = [*known, *found]
        if not context.at_rest or not all(each.score.flawed for each in every):
            return found
        # To drive a turn may need more space than there is: a turn on the spot does not.
        for guess in timed('solve', self.guesses.turning, context):
            if not any(np.array_equal(guess, each) for each in tried):
                found += self._made_from([guess], context)
                tried = [*tried, guess]
        if any(each.candidate.admissible for each in every):
            return found
        # Or it may come too close at first: zero controls do not.
        return [*found, self._improved(self.pool.take(), context.zero_controls, context)]

    def _made_from(
        self, guesses: list[Array], context: PlanningContext, most_work: int | None = None
    ) -> list[Alternative]:
        """New plans, as many as there is work left for."""
        return [
            self._improved(self.pool.take(), guess, context, most_work=most_work)
            for guess in guesses
            if self._improver.work_left > 0
        ]

    def _improved(
        self,
        planner: Planner,
        guess: Array,
        context: PlanningContext,
        bad_steps: int = 0,
        most_work: int | None = None,
    ) -> Alternative:
        candidate = self._improver.improve(planner, guess, context, most_work=most_work)
        return self._scored(planner, candidate, context, bad_steps)

    def _scored(
        self, planner: Planner, candidate: Candidate, context: PlanningContext, bad_steps: int = 0
    ) -> Alternative:
        poses, timed = candidate.plan.poses, self._improver.timed
        sides = timed('audit', class_of, context.road_frame, self._places, poses)
        score = timed('audit', self.ranking.score, candidate, context.start)
        return Alternative(planner, candidate, score, sides, bad_steps)

    def _better(self, known: Candidate, guess: Array, context: PlanningContext) -> Candidate:
        """The better of a plan and one from another guess."""
        planner, score = self.pool.take(), self.ranking.score
        fresh = self._improver.improve(planner, guess, context)
        if score(fresh, context.start).beats(score(known, context.start)):
            self.pool.followed, planner = planner, self.pool.followed
            known = fresh
        self.pool.free.append(planner)
        return known

    def _obstacle_names(self, context: PlanningContext) -> list[str]:
        islands = (
            f'{_GRIDS.get(grid.name, grid.name)} at ({x:.1f}, {y:.1f})'
            for grid in self._space.grids
            for x, y in grid.islands.tolist()
        )
        return [*(each.name for each in self._world.shapes), *context.encounters.names, *islands]
