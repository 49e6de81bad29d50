"""Improvement of plans within the work of a control step, and the plan to follow.

A warm start can be a trap, such as a plan on the side where no time is left. So one for each of
the most promising homotopy classes is kept and improved beside the one followed.
"""

from collections.abc import Callable
from typing import Any, Final, NamedTuple

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.formulation.ocp_formulation import OcpFormulation
from cmpsp_ros.guidance.horizon import retimed, shift
from cmpsp_ros.guidance.planning.candidate import Candidate
from cmpsp_ros.guidance.planning.planner import Planner
from cmpsp_ros.guidance.planning.planning_context import PlanningContext
from cmpsp_ros.guidance.planning.selection import Selection
from cmpsp_ros.guidance.safety.validation import Validator
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.solver_settings import SCREENING
from cmpsp_ros.guidance.world import World

_MILLISECONDS: Final = 1e-6
_LONGEST_PAUSE: Final = 7  # control steps between two reviews while an admissible plan keeps a flaw
_GENEROUS: Final = 4  # factor on the work of a first plan, and on that of the plan followed
_TRANSIENT: Final = 4
"""Control steps for which an admissible plan may mend a flaw: each change of plans is a jerk, and a
robot that is not quite as modelled puts a little of a flaw into every plan."""


class Improver:
    """Improves plans and checks them; all plans of a control step share its work."""

    def __init__(
        self, settings: LawSettings, validator: Validator, timer: Callable[[], int]
    ) -> None:
        self._timer = timer
        self.work_left = 1  # in the present control step
        self.phases: dict[str, float] = {}  # computing times of this step by phase [ms]
        self.take(settings, validator)

    def take(self, settings: LawSettings, validator: Validator) -> None:
        """Take other settings."""
        self._settings, self._validator = settings, validator
        self.work_limit = settings.solver.work_limit(settings.control_period)
        initial = settings.solver.initial_iterations
        # Of several plans only the selected one gets more; on a road without end there is but one.
        is_alone = settings.solver.candidates == 1 or settings.follow is not None
        self._first_iterations = initial if is_alone else min(initial, SCREENING)

    def begin_step(self, context: PlanningContext) -> None:
        """Grant the work of a control step, and measure its times."""
        self.begin_phases()
        self.work_left = self.work_limit >> context.halvings
        # Moves are found when the run has begun: their plan must not take longer than a step.
        if context.plan is None and not context.moves:
            self.work_left *= _GENEROUS

    def begin_phases(self) -> None:
        """Measure times anew: those so far belong to the decision that was made."""
        self.phases = {'solve': 0.0, 'audit': 0.0}

    def guess_from(self, plan: Plan, context: PlanningContext) -> Array:
        """Controls of a plan within the horizon of a step, shape ``(N + 1, r)``."""
        if self._settings.is_soonest:
            return retimed(plan.controls, plan.horizon, context.horizon, context.start.robot)
        return shift(plan.controls, plan.horizon, context.horizon)

    def improve(
        self,
        planner: Planner,
        guess: Array,
        context: PlanningContext,
        iterations: int | None = None,
        generosity: int = 1,
        most_work: int | None = None,
    ) -> Candidate:
        """Improve a plan by as many iterations as given, or as every plan gets, and check it."""
        if iterations is None and context.plan is None:
            iterations = self._first_iterations
        work_limit = max(self.work_left, 0) * generosity
        work_limit = work_limit if most_work is None else min(work_limit, most_work)
        began = self._timer()
        result = planner.improve(context, guess, iterations, work_limit)
        solved = self._timer()
        plan, durations = result.plan, context.horizon.durations
        verdict = self._validator.check(context.start, plan.controls, durations, context.pending)
        self.phases['solve'] += (solved - began) * _MILLISECONDS
        self.phases['audit'] += (self._timer() - solved) * _MILLISECONDS
        self.work_left -= result.work
        if context.delay:
            result = result._replace(plan=plan._replace(delay=context.delay))
        return Candidate.of(result, verdict, context.goal)

    def polish(self, planner: Planner, selected: Candidate, context: PlanningContext) -> Candidate:
        """The plan selected, with the iterations that only it gets."""
        first = selected.result.iterations
        left = self._settings.solver.initial_iterations - first
        may = context.at_rest and selected.feasible and first >= SCREENING
        if not may or context.moves or min(left, self.work_left) <= 0:
            return selected
        polished = self.improve(planner, selected.plan.controls, context, left)
        if not polished.feasible:
            return selected
        count = first + polished.result.iterations
        return polished._replace(result=polished.result._replace(iterations=count))

    def timed(self, phase: str, run: Callable[..., Any], *arguments: Any) -> Any:
        """Result of a function whose computing time belongs to a phase."""
        began = self._timer()
        result = run(*arguments)
        self.phases[phase] += (self._timer() - began) * _MILLISECONDS
        return result


class ReviewSchedule:
    """Decides when new plans are made, less often after failures, and when one may be changed."""

    def __init__(self) -> None:
        self.is_asked, self._task_changed = True, False
        # Steps to wait between reviews, steps since the last one, and steps with a flaw in a row.
        self._pause = self._waited = self._flawed_steps = 0

    def note_change(self) -> None:
        """Ask for a review if the plan that is followed has a flaw after a live change."""
        self._task_changed = True

    def note_followed(self, *, has_flaw: bool) -> None:
        """Count a control step with a plan to follow."""
        if has_flaw:
            self._waited += 1
            self._flawed_steps += 1
        else:
            self._pause = self._waited = self._flawed_steps = 0
        self.is_asked = self.is_asked or (self._task_changed and self._flawed_steps > 0)
        self._task_changed = False

    def is_due(self, followed: Candidate) -> tuple[bool, bool]:
        """True if new plans are to be made, and if another one may be followed."""
        is_urgent = self.is_asked or not followed.admissible
        is_lasting = self._flawed_steps > _TRANSIENT
        return is_urgent or (is_lasting and self._waited > self._pause), is_urgent or is_lasting

    def note_selected(self, *, changed: bool, reviewed: bool) -> None:
        """Note if the plan was changed, and if there was a review."""
        if changed:
            self._flawed_steps = 0
        if reviewed:
            self.is_asked, self._waited = False, 0
            self._pause = 0 if changed else min(2 * self._pause + 1, _LONGEST_PAUSE)


class _Comparison(NamedTuple):
    """A comparison of the plan that was improved with others, put off until the command is out."""

    warm: Candidate
    context: PlanningContext
    review: bool
    may_change: bool


class PlanSelector:
    """Improves the plan that is followed, and others where that may help, and selects one.

    Where a scanner leaves less time, they are compared after the command, for the next step.
    """

    def __init__(
        self, settings: LawSettings, world: World, validator: Validator, timer: Callable[[], int]
    ) -> None:
        self._settings, self._validator = settings, validator
        self.improver = Improver(settings, validator, timer)
        self._formulation = OcpFormulation(settings, world)
        self._selection = Selection(self._formulation, self.improver)
        self._world = world
        self._comparison: _Comparison | None = None
        # The plan followed last, the one that it is continued with, and the sentence on that.
        self._instead: tuple[Plan, Plan] | None = None
        self._found = ''
        self.forget()

    def reconfigure(self, settings: LawSettings, world: World, validator: Validator) -> None:
        """Take other settings and another world; the warm start stays where it can."""
        if validator is not self._validator:
            self._settings, self._validator = settings, validator
            self.improver.take(settings, validator)
            self._selection.take(settings)
            self._reformulate(self._world)
        if world is not self._world:
            self._update_world(world)
        self._formulation.prepare(world)

    def _reformulate(self, world: World) -> None:
        self._reviews.note_change()
        self._world = world
        self._formulation = OcpFormulation(self._settings, world)
        self._selection.reformulate(self._formulation)

    def _update_world(self, world: World) -> None:
        """Keep the plan in another world; alternatives were of the one before."""
        before, self._world = self._world, world
        if len(world.shapes) != len(before.shapes):
            self._reformulate(world)
            return
        if world.road is not before.road or world.obstacles is not before.obstacles:
            self._reviews.note_change()
        self._selection.use(world)
        self._selection.pool.forget()

    def forget(self) -> None:
        """Forget all alternatives, and search all homotopy classes at the next control step."""
        self._selection.pool.forget()
        self._reviews, self.remark = ReviewSchedule(), ''
        self._comparison, self._instead, self._found = None, None, ''

    def restart(self) -> None:
        """Forget the warm start too: the model has changed."""
        self.forget()
        self._selection.pool.followed.forget()

    def request_replanning(self) -> None:
        """Search all homotopy classes at the next control step."""
        self._reviews.is_asked = True

    def best(self, context: PlanningContext) -> Candidate:
        """Improve the plan, and others where that may help, and select one."""
        if context.start.world is not self._world:
            self._update_world(context.start.world)
        self._selection.remark, self._found = self._found, ''
        selected = self._best(context)
        self._instead = None
        self._update_remark()
        return selected

    def _best(self, context: PlanningContext) -> Candidate:
        improver, selection, reviews = self.improver, self._selection, self._reviews
        improver.begin_step(context)
        self._comparison = None
        # The plan that is followed comes first; the others share the work that it leaves. In a step
        # that begins without a plan that is at least half of the work.
        guess, first = self._guesses_of(context)
        least = improver.work_left // 2 if first is not None and len(first) > 1 else 0
        generosity = 1 if context.moves else _GENEROUS
        warm = improver.improve(selection.pool.followed, guess, context, generosity=generosity)
        improver.work_left = max(improver.work_left, least)
        if selection.limit == 1:
            return selection.only(warm, context)
        if context.plan is not None:
            has_flaw = selection.ranking.needs_replanning(warm, context.start)
            reviews.note_followed(has_flaw=has_flaw)
        is_due, may_change = reviews.is_due(warm)
        review = is_due or context.plan is None
        if not review and not selection.pool.alternatives:
            return warm
        comparison = _Comparison(warm, context, review, may_change)
        if first is None and context.start.world.seen is not None:
            self._comparison = comparison
            return warm
        return self._compared(comparison, first)

    def _compared(self, comparison: _Comparison, first: list[Array] | None) -> Candidate:
        warm, context, review, may_change = comparison
        selection = self._selection
        selected, changed = selection.best(
            warm, context, first, review=review, may_change=may_change
        )
        self._reviews.note_selected(changed=changed, reviewed=review)
        return self.improver.polish(selection.pool.followed, selected, context)

    def compare(self) -> Candidate | None:
        """The plan to go on with, where a comparison was put off; None if there was none."""
        comparison, self._comparison = self._comparison, None
        self.improver.begin_phases()
        if comparison is None:
            return None
        selected = self._compared(comparison, None)
        self._found = self._selection.remark
        return selected

    def go_on_with(self, followed: Plan, plan: Plan) -> None:
        """Continue a plan at the next step instead of the one that it would begin with."""
        self._instead = followed, plan

    def _guesses_of(self, context: PlanningContext) -> tuple[Array, list[Array] | None]:
        """Guess of the plan that is followed, and all of a step that begins without one."""
        plan, selection = context.plan, self._selection
        if plan is None:
            selection.pool.followed.forget()
            guesses = self.improver.timed('solve', selection.guesses.first, context)
            return guesses[0], guesses
        if self._instead is not None and plan is self._instead[0]:
            plan = self._instead[1]
        earlier = plan.horizon.edges.item(-1) - context.horizon.edges.item(-1)
        # Put off, or earlier: rows of its warm start would be at other places.
        if earlier > 0 or len(context.horizon.edges) > len(plan.horizon.edges):
            selection.pool.followed.forget()
        return self.improver.guess_from(plan, context), None

    def try_at_another_time(
        self, plan: Plan, context: PlanningContext, accepts: Callable[[Candidate], bool]
    ) -> Candidate:
        """Improve a plan that ends earlier or later, and follow it if it is accepted."""
        pool, improver = self._selection.pool, self.improver
        planner, left = pool.take(), improver.work_left
        improver.work_left = granted = max(left // 2, improver.work_limit // 8)
        guess = improver.guess_from(plan, context)
        found = improver.improve(planner, guess, context, SCREENING)
        improver.work_left += left - granted
        if accepts(found):
            planner, pool.followed = pool.followed, planner
        pool.free.append(planner)
        self._update_remark()
        return found

    def _update_remark(self) -> None:
        is_used_up = self.improver.work_left <= 0
        self.remark = self._selection.remark + ' The work of this step was used up.' * is_used_up
