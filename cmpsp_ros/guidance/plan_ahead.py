"""Plans for the next control step: what takes longer than a command may wait."""

from dataclasses import replace

from cmpsp_ros.guidance.horizon import remaining
from cmpsp_ros.guidance.planning.candidate import Candidate
from cmpsp_ros.guidance.planning.plan_selector import PlanSelector
from cmpsp_ros.guidance.planning.planning_context import PlanningContext
from cmpsp_ros.guidance.prediction.estimator import Observation
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.state import LawState
from cmpsp_ros.guidance.times import to_nanoseconds


class PlanAhead:
    """Plans on after the command, where a scanner leaves a step less time, for the next step."""

    def __init__(self, settings: LawSettings, selector: PlanSelector) -> None:
        self._settings, self._selector = settings, selector
        self._period = to_nanoseconds(settings.control_period)

    def at_soonest(
        self, state: LawState, context: PlanningContext, selected: Candidate
    ) -> tuple[PlanningContext, Candidate]:
        """The plan to follow instead of the selected one, and its control step."""
        if not self._ends_soonest(state):
            return context, selected
        context, selected = state.mission.arrival.set_out(self._selector, context, selected)
        if state.world.seen is None or not selected.admissible:
            context, selected = self._at_another_time(state, context, selected)
        self._reach_with(state, context)
        return context, selected

    def reason_to_prepare(
        self, state: LawState, observation: Observation, context: PlanningContext
    ) -> str:
        """Why to stand while the first plan is made, in a sentence; '' to make it at once."""
        moves, goals = self._settings.moves_final_time, state.mission.goals
        if state.clock.step or observation.sighting is None or not moves:
            return ''
        horizon = remaining(state.clock.due, self._period, goals.final - context.delay)
        state.planned = replace(context, horizon=horizon), None
        return 'The robot stands for one control period, while the first plan is made.'

    def go_on(self, state: LawState) -> None:
        """Plan for the next control step, once the command is out."""
        planned, state.planned = state.planned, None
        if planned is None:
            return
        context, followed = planned
        if followed is None:
            self._make_first(state, context)
            return
        selected = self._selector.compare() or followed
        if self._ends_soonest(state) and state.world.seen is not None:
            changed, selected = self._at_another_time(state, context, selected)
            if changed is not context:
                self._reach_with(state, changed)
        if selected is followed:
            return
        begins = state.following.plan or state.following.standby
        if begins is None:
            state.following.wait(selected.plan)
        else:
            self._selector.go_on_with(begins, selected.plan)

    def _make_first(self, state: LawState, context: PlanningContext) -> None:
        context = replace(context, start=context.start._replace(world=state.world))
        if not state.mission.search_moves(context):
            selected = self._selector.best(context)
            state.planned = context, selected = self.at_soonest(state, context, selected)
            state.following.wait(selected.plan)
            self.go_on(state)

    def _ends_soonest(self, state: LawState) -> bool:
        return self._settings.is_soonest and state.mission.goals.goal is not None

    def _at_another_time(
        self, state: LawState, context: PlanningContext, selected: Candidate
    ) -> tuple[PlanningContext, Candidate]:
        """A plan that ends earlier, or later where the selected one has a flaw."""
        latest = state.mission.goals.latest(state.clock.now, context.start)
        return state.mission.arrival.another(self._selector, context, selected, latest)

    def _reach_with(self, state: LawState, context: PlanningContext) -> None:
        """Reach the goal at the end of a horizon."""
        goals, clock = state.mission.goals, state.clock
        goals.reach_at(context.horizon.edges.item(-1) + context.delay)
        clock.due = remaining(clock.now, goals.period, goals.final).edges.item(1)
