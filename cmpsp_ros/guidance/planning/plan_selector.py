"""Selection of a plan: the one that is followed, alternatives in a pool, and new ones.

A warm start can be a trap, such as a plan that ends before an obstacle because it once led to its
middle, or one on the side where no time is left. So where plans can differ in more than detail,
one for each of the most promising homotopy classes is kept and improved beside the one followed.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.formulation.ocp_formulation import OcpFormulation
from cmpsp_ros.guidance.horizon import retimed, shift
from cmpsp_ros.guidance.planning.alternative_pool import Alternative, AlternativePool
from cmpsp_ros.guidance.planning.candidate import Candidate, Ranking
from cmpsp_ros.guidance.planning.homotopy.path_search import class_of, in_words
from cmpsp_ros.guidance.planning.planner import Planner
from cmpsp_ros.guidance.planning.planning_context import Guesses, PlanningContext
from cmpsp_ros.guidance.safety.validation import Validator
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.solver_settings import SCREENING
from cmpsp_ros.guidance.world import MAP, SEEN, World
from cmpsp_ros.world import FreeSpace

_MILLISECONDS: Final = 1e-6
_GRIDS: Final = {SEEN: 'what is seen', MAP: 'the map'}
"""Names in messages of obstacles that are grids."""
_LONGEST_PAUSE: Final = 7
"""Control steps between two reviews, at most, while an admissible plan keeps a flaw."""
_GENEROUS: Final = 4
"""Factor on the work of a step at rest without a plan, and on that for the plan followed."""
_TRANSIENT: Final = 4
"""Control steps for which an admissible plan may mend a flaw: each change of plans is a jerk, and a
robot that is not quite as modelled puts a little of a flaw into every plan."""


class PlanSelector:
    """Improves plans, and selects the one to follow.

    Attributes:
        phases: Computing times of the last control step by phase [ms].
    """

    def __init__(
        self, settings: LawSettings, world: World, validator: Validator, timer: Callable[[], int]
    ) -> None:
        """Start without a plan; the timer gives monotonic time [ns]."""
        self._timer = timer
        self._take(settings, validator)
        self.phases: dict[str, float] = {}
        # Road coordinates of all obstacles in the control step.
        self._places = np.empty(0), np.empty(0)
        self._work_left = 1
        formulation = OcpFormulation(settings, world)
        self._pool = AlternativePool(formulation, max(1, self._limit - 1))
        self._formulate(formulation)
        self.forget()

    def reconfigure(self, settings: LawSettings, world: World, validator: Validator) -> None:
        """Take other settings and another world, so that the next step need not.

        The plan that is followed keeps its memory and its warm start where it can.
        """
        if validator is not self._validator:
            self._take(settings, validator)
            self._formulate_again(OcpFormulation(settings, self._world))
        if world is not self._world:
            self._update_world(world)
        self._formulation.prepare(world)

    def _take(self, settings: LawSettings, validator: Validator) -> None:
        self._settings, self._validator = settings, validator
        # A road without end has no goal that guide paths could lead to.
        self._limit = settings.solver.candidates if settings.follow is None else 1
        self._work_limit = settings.solver.work_limit(settings.control_period)
        self._ranking = Ranking(settings, compares=self._limit > 1)

    def _formulate(self, formulation: OcpFormulation) -> None:
        self._formulation = formulation
        self._guesses = Guesses(formulation, self._limit)
        self._use(formulation.world)

    def _formulate_again(self, formulation: OcpFormulation) -> None:
        self._task_changed = True
        self._formulate(formulation)
        self._pool.reformulate(formulation)

    def _use(self, world: World) -> None:
        self._world = world
        self._space = FreeSpace.of(world.road, world.shapes, 0.0)

    def _update_world(self, world: World) -> None:
        """Keep the plan in another world; alternatives were of the one before."""
        before = self._world
        if len(world.shapes) != len(before.shapes):
            self._formulate_again(OcpFormulation(self._settings, world))
            return
        known = world.road is before.road and world.obstacles is before.obstacles
        self._task_changed = self._task_changed or not known
        self._use(world)
        self._pool.forget()

    def forget(self) -> None:
        """Forget all alternatives, and search all homotopy classes at the next control step."""
        self._pool.forget()
        self._review, self._task_changed = True, False
        # Steps to wait between reviews, steps since the last one, and steps with a flaw in a row.
        self._pause = self._waited = self._flawed_steps = 0
        self._remark = ''

    def restart(self) -> None:
        """Forget the warm start too: the model has changed."""
        self.forget()
        self._pool.followed.forget()

    def request_replanning(self) -> None:
        """Search all homotopy classes at the next control step."""
        self._review = True

    @property
    def remark(self) -> str:
        """Sentence on which of how many plans was selected last; empty if there was one."""
        is_used_up = self._work_left <= 0
        return f'{self._remark} The work of this step was used up.' if is_used_up else self._remark

    def best(self, context: PlanningContext) -> Candidate:
        """Improve the plan, and others where that may help, and select one."""
        if context.start.world is not self._world:
            self._update_world(context.start.world)
        plan, guesses = context.plan, None
        self.phases, self._remark = {'solve': 0.0, 'audit': 0.0}, ''
        # The plan that is followed comes first; the others share the work that it leaves.
        self._work_left = self._work_limit >> context.halvings
        if plan is None:
            self._work_left *= _GENEROUS
            self._pool.followed.forget()
            guess, *guesses = self._timed('solve', self._guesses.first, context)
        else:
            guess = self._guess_from(plan, context)
            # Put off: rows of its warm start would be at other places.
            if len(context.horizon.edges) > len(plan.horizon.edges):
                self._pool.followed.forget()
        warm = self._improve(self._pool.followed, guess, context, generosity=_GENEROUS)
        if self._limit == 1:
            return self._or_fallback(warm, context)
        if guesses is None:
            if self._ranking.needs_replanning(warm, context.start):
                self._waited += 1
                self._flawed_steps += 1
            else:
                self._pause = self._waited = self._flawed_steps = 0
            # A live change asks for other plans only where the one that is followed has a flaw.
            self._review = self._review or (self._task_changed and self._flawed_steps > 0)
            self._task_changed = False
        is_lasting, is_asked = self._flawed_steps > _TRANSIENT, self._review or not warm.admissible
        may_change = is_asked or is_lasting
        # New plans are made ever less often where that has not helped for a while.
        is_due = is_asked or (is_lasting and self._waited > self._pause)
        review = guesses is not None or is_due
        if not review and not self._pool.alternatives:
            return warm
        selected = self._select(warm, context, guesses, review=review, may_change=may_change)
        return self._polished(selected, context)

    def _guess_from(self, plan: Plan, context: PlanningContext) -> Array:
        """Controls of a plan within the horizon of a step, shape ``(N + 1, r)``."""
        if self._settings.is_soonest:
            return retimed(plan.controls, plan.horizon, context.horizon, context.start.robot)
        return shift(plan.controls, plan.horizon, context.horizon)

    def try_at_another_time(
        self, plan: Plan, context: PlanningContext, accepts: Callable[[Candidate], bool]
    ) -> Candidate:
        """Improve a plan that ends earlier or later, and follow it if it is accepted."""
        planner, left = self._pool.take(), self._work_left
        self._work_left = granted = max(left // 2, min(left, self._work_limit // 8))
        found = self._improve(planner, self._guess_from(plan, context), context, SCREENING)
        self._work_left += left - granted
        if accepts(found):
            planner, self._pool.followed = self._pool.followed, planner
        self._pool.free.append(planner)
        return found

    def _timed(self, phase: str, run: Callable[..., Any], *arguments: Any) -> Any:
        began = self._timer()
        result = run(*arguments)
        self.phases[phase] += (self._timer() - began) * _MILLISECONDS
        return result

    def _or_fallback(self, warm: Candidate, context: PlanningContext) -> Candidate:
        """The only plan; if it has a flaw, one along the centre line or one at rest may be better.

        A moving obstacle may come too close at first: then a robot at rest may stay there.
        """
        if warm.feasible or self._work_left <= 0:
            return warm
        best = self._better(warm, context.center_line_guess, context)
        if best.admissible or not context.at_rest:
            return best
        return self._better(best, _zero_controls(context), context)

    def _better(self, known: Candidate, guess: Array, context: PlanningContext) -> Candidate:
        """The better of a plan and one from another guess."""
        planner, score = self._pool.take(), self._ranking.score
        fresh = self._improve(planner, guess, context)
        if score(fresh, context.start).beats(score(known, context.start)):
            self._pool.followed, planner = planner, self._pool.followed
            known = fresh
        self._pool.free.append(planner)
        return known

    def _select(
        self,
        warm: Candidate,
        context: PlanningContext,
        guesses: list[Array] | None,
        *,
        review: bool,
        may_change: bool,
    ) -> Candidate:
        """Improve alternatives, make new ones in a review, and select the best plan."""
        centers = [self._space.centers, context.encounters.centers, self._space.islands]
        self._places = context.road_frame.coordinates(np.concatenate(centers))
        followed = self._scored(self._pool.followed, warm, context)
        # A new plan must fit in beside those that are known.
        capacity = self._limit - 2 if review else self._limit - 1
        improved, waiting = [], []
        for each in self._pool.worth_improving(capacity):
            if self._work_left > 0:
                plan = each.candidate.plan
                guess = self._guess_from(plan, context)
                improved.append(self._improved(each.planner, guess, context, each.bad_steps))
            else:
                waiting.append(each)
        if review:
            self._review = False
            improved += self._new_alternatives([followed, *improved], context, guesses)
        best = followed
        if may_change:
            for each in improved:
                best = each if each.score.beats(best.score) else best
        changed = best is not followed
        self._flawed_steps = 0 if changed else self._flawed_steps
        self._pool.keep(best, [followed, *improved], waiting)
        if review:
            self._waited = 0
            self._pause = 0 if changed else min(2 * self._pause + 1, _LONGEST_PAUSE)
        if improved:
            words = in_words(best.homotopy_class, self._obstacle_names(context))
            verb = 'Changed over to' if changed and not context.at_rest else 'It is'
            sides = f'{1 + len(improved)} plans{", " if words else ""}{words}'
            self._remark = f' {verb} the best of {sides}.'
        return best.candidate

    def _obstacle_names(self, context: PlanningContext) -> list[str]:
        islands = (
            f'{_GRIDS.get(grid.name, grid.name)} at ({x:.1f}, {y:.1f})'
            for grid in self._space.grids
            for x, y in grid.islands.tolist()
        )
        return [*(each.name for each in self._world.shapes), *context.encounters.names, *islands]

    def _new_alternatives(
        self, known: list[Alternative], context: PlanningContext, guesses: list[Array] | None
    ) -> list[Alternative]:
        """New plans; without guesses, of homotopy classes that no plan without a flaw has yet."""
        if guesses is None:
            taken = {each.homotopy_class for each in known if not each.score.flawed}
            capacity = self._limit - len(known)
            fresh = self._timed('solve', self._guesses.fresh, context, capacity, taken)
            guesses = fresh[:capacity]
        found = self._made_from(guesses, context)
        every = [*known, *found]
        if not context.at_rest or not all(each.score.flawed for each in every):
            return found
        # To drive a turn may need more space than there is: a turn on the spot does not.
        found += self._made_from(self._timed('solve', self._guesses.turning, context), context)
        if any(each.candidate.admissible for each in every):
            return found
        # Or it may come too close at first: zero controls do not.
        return [*found, self._improved(self._pool.take(), _zero_controls(context), context)]

    def _made_from(self, guesses: list[Array], context: PlanningContext) -> list[Alternative]:
        """New plans, as many as there is work left for."""
        return [
            self._improved(self._pool.take(), guess, context)
            for guess in guesses
            if self._work_left > 0
        ]

    def _improved(
        self, planner: Planner, guess: Array, context: PlanningContext, bad_steps: int = 0
    ) -> Alternative:
        return self._scored(planner, self._improve(planner, guess, context), context, bad_steps)

    def _scored(
        self, planner: Planner, candidate: Candidate, context: PlanningContext, bad_steps: int = 0
    ) -> Alternative:
        poses = candidate.plan.poses
        sides = self._timed('audit', class_of, context.road_frame, self._places, poses)
        score = self._timed('audit', self._ranking.score, candidate, context.start)
        return Alternative(planner, candidate, score, sides, bad_steps)

    def _polished(self, selected: Candidate, context: PlanningContext) -> Candidate:
        """The plan selected, with the iterations that only it gets."""
        first = selected.result.iterations
        left = self._settings.solver.initial_iterations - first
        may = context.at_rest and selected.feasible and first >= SCREENING
        if not may or min(left, self._work_left) <= 0:
            return selected
        polished = self._improve(self._pool.followed, selected.plan.controls, context, left)
        if not polished.feasible:
            return selected
        count = first + polished.result.iterations
        return polished._replace(result=polished.result._replace(iterations=count))

    def _improve(
        self,
        planner: Planner,
        guess: Array,
        context: PlanningContext,
        iterations: int | None = None,
        generosity: int = 1,
    ) -> Candidate:
        """Improve a plan by as many iterations as given, or as every plan gets, and check it."""
        if iterations is None and context.plan is None:
            initial = self._settings.solver.initial_iterations
            iterations = initial if self._limit == 1 else min(initial, SCREENING)
        work_limit = max(self._work_left, 0) * generosity
        began = self._timer()
        result = planner.improve(context, guess, iterations, work_limit)
        solved = self._timer()
        plan, durations = result.plan, context.horizon.durations
        verdict = self._validator.check(context.start, plan.controls, durations, context.pending)
        self.phases['solve'] += (solved - began) * _MILLISECONDS
        self.phases['audit'] += (self._timer() - solved) * _MILLISECONDS
        self._work_left -= result.work
        if context.delay:
            result = result._replace(plan=plan._replace(delay=context.delay))
        return Candidate.of(result, verdict, context.goal)


def _zero_controls(context: PlanningContext) -> Array:
    """Controls of a robot at rest, shape ``(N + 1, r)``."""
    return np.zeros((len(context.horizon.edges), context.start.robot.n_controls))
