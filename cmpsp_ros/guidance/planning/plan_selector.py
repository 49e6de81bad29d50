"""The selection of a plan: the one that is followed, alternatives kept beside it, and new ones.

A warm start can be a trap, such as a plan that ends before an obstacle because it once led to its
middle, or one on the side where no time is left. So where plans can differ in more than detail,
one for each of the most promising homotopy classes is kept and improved beside the one followed.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.formulation.ocp_formulation import OcpFormulation
from cmpsp_ros.guidance.horizon import shift
from cmpsp_ros.guidance.planning.alternative_pool import Alternative, AlternativePool
from cmpsp_ros.guidance.planning.candidate import Candidate
from cmpsp_ros.guidance.planning.guesses import Guesses
from cmpsp_ros.guidance.planning.homotopy.path_search import class_of, in_words
from cmpsp_ros.guidance.planning.planner import Planner
from cmpsp_ros.guidance.planning.planning_context import PlanningContext
from cmpsp_ros.guidance.planning.ranking import Ranking
from cmpsp_ros.guidance.safety.audit import Audit
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.solver_settings import SCREENING
from cmpsp_ros.guidance.world import MAP, SEEN, World
from cmpsp_ros.world import FreeSpace

_MILLISECONDS = 1e-6

# What parts of an obstacle that is a grid are parts of.
_WORDS = {SEEN: 'what is seen', MAP: 'the map'}

# New plans are made every control step if the one followed is not admissible, else ever less often.
_LONGEST_PAUSE = 7
# How much more work a step may do at rest without a plan, and on the plan that is followed.
_GENEROUS = 4
# Control steps for which an admissible plan is given the time to mend a flaw. A robot that is not
# quite as modelled puts a little of one into every plan, and each change of plans is a jerk.
_TRANSIENT = 4


class PlanSelector:
    """Improves plans and says which to follow."""

    def __init__(
        self, settings: LawSettings, world: World, audit: Audit, timer: Callable[[], int]
    ) -> None:
        """Take the settings, without any plan.

        Args:
            settings: All settings of the guidance law.
            world: Road and static obstacles.
            audit: What every plan must pass.
            timer: Monotonic time [ns].
        """
        self._settings, self._audit, self._timer = settings, audit, timer
        # A road without end has no goal that ways could lead to.
        self._limit = settings.solver.candidates if settings.follow is None else 1
        self._ranking = Ranking(settings, compares=self._limit > 1)
        self.phases: dict[str, float] = {}
        # Of all obstacles, in the road frame of the control step.
        self._places = np.empty(0), np.empty(0)
        self._work_left = 1
        self._formulate(world)

    def reconfigure(self, settings: LawSettings, world: World, audit: Audit) -> None:
        """Take other settings."""
        self.__init__(settings, world, audit, self._timer)  # type: ignore[misc]

    def _formulate(self, world: World) -> None:
        self._formulation = OcpFormulation(self._settings, world)
        self._guesses = Guesses(self._formulation, self._limit)
        self._pool = AlternativePool(self._formulation, max(1, self._limit - 1))
        self._take(world)
        self.forget()

    def _take(self, world: World) -> None:
        self._world = world
        self._space = FreeSpace.of(world.road, world.shapes, 0.0)

    def _update(self, world: World) -> None:
        """Go on in another world; alternatives were of the one before."""
        if world is self._world:
            return
        if len(world.shapes) != len(self._world.shapes):
            self._formulate(world)
            return
        self._take(world)
        self._pool.forget()

    def forget(self) -> None:
        """Begin again: all homotopy classes are searched afresh at the next control step."""
        self._pool.forget()
        self._review = True
        self._pause = self._waited = self._troubled = 0
        self._remark = ''

    def restart(self) -> None:
        """Begin again, without a warm start either: the model has changed."""
        self.forget()
        self._pool.followed.forget()

    def look_again(self) -> None:
        """Search all homotopy classes at the next control step: a new obstacle is seen."""
        self._review = True

    @property
    def remark(self) -> str:
        """Which plan was selected last, and of how many, in a sentence; empty if there was one."""
        if self._work_left > 0:
            return self._remark
        return f'{self._remark} The work of this step was used up.'

    def best(self, context: PlanningContext) -> Candidate:
        """Improve the plan, and others where that may help, and select one."""
        self._update(context.start.world)
        plan, horizon = context.plan, context.horizon
        self.phases, self._remark = dict.fromkeys(('solve', 'audit'), 0.0), ''
        # The plan that is followed comes first; the others share the work that it leaves.
        work_limit = self._settings.solver.work_limit(self._settings.control_period)
        self._work_left = work_limit >> context.halvings
        if plan is None:
            self._work_left *= _GENEROUS
            self._pool.followed.forget()
            guess, *others = self._timed_guesses(self._guesses.first, context)
        else:
            guess, others = shift(plan.controls, plan.horizon, horizon), None
        warm = self._improve(self._pool.followed, guess, context, generosity=_GENEROUS)
        if self._limit == 1:
            return self._or_fresh(warm, context)
        review = others is not None or self._wants_review(warm, context)
        if not review and not self._pool.alternatives:
            return warm
        return self._polish(self._select(warm, context, others, review=review), context)

    def _timed_guesses(self, make: Callable[..., list[Array]], *arguments: Any) -> list[Array]:
        began = self._timer()
        guesses = make(*arguments)
        self.phases['solve'] += (self._timer() - began) * _MILLISECONDS
        return guesses

    def _wants_review(self, warm: Candidate, context: PlanningContext) -> bool:
        """Whether to look for new plans; less often where that has not helped for a while."""
        if not self._ranking.needs_replanning(warm, context.start):
            self._pause = self._waited = self._troubled = 0
            return self._review
        self._waited += 1
        self._troubled += 1
        return (
            self._review
            or not warm.admissible
            or (self._troubled > _TRANSIENT and self._waited > self._pause)
        )

    def _may_change(self, warm: Candidate) -> bool:
        """Whether the plan that is followed may be replaced at all."""
        return self._review or not warm.admissible or self._troubled > _TRANSIENT

    def _or_fresh(self, warm: Candidate, context: PlanningContext) -> Candidate:
        """Where the only plan has a flaw, one along the centre line if that is better.

        A moving obstacle may come too close at first: at rest, a plan that stays there is tried
        as well.
        """
        if warm.feasible or self._work_left <= 0:
            return warm
        best = self._better(warm, context.center_line_guess, context)
        if best.admissible or not context.at_rest:
            return best
        return self._better(best, _zero_controls(context), context)

    def _better(self, known: Candidate, guess: Array, context: PlanningContext) -> Candidate:
        """A plan, or one from another guess, if that is better."""
        planner, score = self._pool.take(), self._ranking.score
        fresh = self._improve(planner, guess, context)
        better = score(fresh, context.start).beats(score(known, context.start))
        self._pool.follow_better(planner, better=better)
        return fresh if better else known

    def _select(
        self,
        warm: Candidate,
        context: PlanningContext,
        guesses: list[Array] | None,
        *,
        review: bool,
    ) -> Candidate:
        centers = np.concatenate(
            [self._space.centers, context.encounters.centers, self._space.islands]
        )
        self._places = context.road_frame.coordinates(centers)
        followed = self._scored(self._pool.followed, warm, context)
        may_change = self._may_change(warm)
        # A fresh plan must fit in beside those that are known.
        capacity = self._limit - 2 if review else self._limit - 1
        improved, waiting = [], []
        for each in self._pool.worth_improving(capacity):
            if self._work_left > 0:
                improved.append(self._continued(each, context))
            else:
                waiting.append(each)
        if review:
            self._review = False
            improved += self._fresh([followed, *improved], context, guesses)
        best = followed
        if may_change:
            for each in improved:
                best = each if each.score.beats(best.score) else best
        self._troubled = self._troubled if best is followed else 0
        self._pool.keep(best, [followed, *improved], waiting)
        if review:
            self._waited = 0
            self._pause = 0 if best is not followed else min(2 * self._pause + 1, _LONGEST_PAUSE)
        changed = best is not followed and not context.at_rest
        self._remark = self._remark_on(best, 1 + len(improved), context, changed=changed)
        return best.candidate

    def _remark_on(
        self, best: Alternative, count: int, context: PlanningContext, *, changed: bool
    ) -> str:
        if count == 1:
            return ''
        islands = (
            f'{_WORDS.get(grid.name, grid.name)} at ({x:.1f}, {y:.1f})'
            for grid in self._space.grids
            for x, y in grid.islands.tolist()
        )
        names = [*(each.name for each in self._world.shapes), *context.encounters.names, *islands]
        words = in_words(best.homotopy_class, names)
        sides = f', {words}' if words else ''
        verb = 'Changed over to' if changed else 'It is'
        return f' {verb} the best of {count} plans{sides}.'

    def _fresh(
        self, known: list[Alternative], context: PlanningContext, guesses: list[Array] | None
    ) -> list[Alternative]:
        """New plans; without guesses, of homotopy classes that no flawless plan has yet."""
        if guesses is None:
            taken = {each.homotopy_class for each in known if not each.score.flawed}
            capacity = self._limit - len(known)
            guesses = self._timed_guesses(self._guesses.fresh, context, capacity, taken)[:capacity]
        fresh = self._new_ones(guesses, context)
        every = [*known, *fresh]
        if not context.at_rest or not all(each.score.flawed for each in every):
            return fresh
        # To drive a turn may need more space than there is: a turn on the spot does not.
        turning = self._timed_guesses(self._guesses.turning, context)
        fresh += self._new_ones(turning, context)
        if any(each.candidate.admissible for each in every):
            return fresh
        # Or it may come too close at first: zero controls do not.
        return [*fresh, self._new(_zero_controls(context), context)]

    def _new_ones(self, guesses: list[Array], context: PlanningContext) -> list[Alternative]:
        """New plans, as many as there is work left for."""
        return [self._new(guess, context) for guess in guesses if self._work_left > 0]

    def _new(self, guess: Array, context: PlanningContext) -> Alternative:
        planner = self._pool.take()
        return self._scored(planner, self._improve(planner, guess, context), context)

    def _continued(self, known: Alternative, context: PlanningContext) -> Alternative:
        plan = known.candidate.plan
        guess = shift(plan.controls, plan.horizon, context.horizon)
        candidate = self._improve(known.planner, guess, context)
        return self._scored(known.planner, candidate, context, known.bad_steps)

    def _scored(
        self, planner: Planner, candidate: Candidate, context: PlanningContext, bad_steps: int = 0
    ) -> Alternative:
        began = self._timer()
        sides = class_of(context.road_frame, self._places, candidate.plan.poses)
        score = self._ranking.score(candidate, context.start)
        self.phases['audit'] += (self._timer() - began) * _MILLISECONDS
        return Alternative(planner, candidate, score, sides, bad_steps)

    def _polish(self, selected: Candidate, context: PlanningContext) -> Candidate:
        """The plan selected, with the iterations that the others need not have."""
        first = selected.result.iterations
        left = self._settings.solver.initial_iterations - first
        if not context.at_rest or not selected.feasible or first < SCREENING:
            return selected
        if left <= 0 or self._work_left <= 0:
            return selected
        polished = self._improve(self._pool.followed, selected.plan.controls, context, left)
        if not polished.feasible:
            return selected
        count = first + polished.result.iterations
        return polished._replace(result=polished.result._replace(iterations=count))

    def _iterations(self, context: PlanningContext) -> int | None:
        """How many every plan is given at first; None for as many as at any control step."""
        if not context.at_rest:
            return None
        initial = self._settings.solver.initial_iterations
        return initial if self._limit == 1 else min(initial, SCREENING)

    def _improve(
        self,
        planner: Planner,
        guess: Array,
        context: PlanningContext,
        iterations: int = 0,
        generosity: int = 1,
    ) -> Candidate:
        began = self._timer()
        work_limit = max(self._work_left, 0) * generosity
        result = planner.improve(
            context, guess, iterations or self._iterations(context), work_limit
        )
        self._work_left -= result.work
        solved = self._timer()
        verdict = self._audit.check(
            context.start, result.plan.controls, context.horizon.durations, context.pending
        )
        self.phases['solve'] += (solved - began) * _MILLISECONDS
        self.phases['audit'] += (self._timer() - solved) * _MILLISECONDS
        if context.delay:
            result = result._replace(plan=result.plan._replace(delay=context.delay))
        return Candidate.of(result, verdict, context.goal)


def _zero_controls(context: PlanningContext) -> Array:
    """Controls of a robot at rest, shape ``(N + 1, r)``."""
    return np.zeros((len(context.horizon.edges), context.start.robot.n_controls))
