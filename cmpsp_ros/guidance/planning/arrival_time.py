"""The final time of goals that are to be passed as early as possible: a search, step by step.

Within a plan the final time is fixed. At each control step a plan that ends a stride earlier is
tried, made from the present one driven faster: if it meets every constraint it is followed, and
the next stride is longer, else shorter. A plan with a flaw is tried with more time.
"""

from dataclasses import dataclass, replace
from typing import Final

from cmpsp_ros.guidance.horizon import remaining
from cmpsp_ros.guidance.planning.candidate import Candidate, reserve
from cmpsp_ros.guidance.planning.plan_selector import PlanSelector
from cmpsp_ros.guidance.planning.planning_context import PlanningContext
from cmpsp_ros.guidance.safety.unseen import drives_blind
from cmpsp_ros.guidance.safety.validation import TOUCHING
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.times import NANOSECONDS, to_nanoseconds

_GRID: Final = 20  # final times in a control period
_LONGEST, _DELAY = 0.15, 0.0025  # longest stride, first one to a later end: parts of the time left
_GROWTH: Final = 2.0  # factor on a stride after a success
_LONGER: Final = 8.0  # factor from that stride to the second one
_MORE: Final = 4.0  # factor on both after a step at which neither helped
_TRIALS, _INITIAL_TRIALS = 2, 6  # trials at a control step, and at the first one to a goal
_INITIAL_DELAYS: Final = 3  # searches for the first one with more time
_INITIAL_DELAY: Final = 0.4  # by how much more in such a search, as a fraction
_FEWEST: Final = 5  # control periods before the goal in which it is not passed any earlier
_OF_MARGIN: Final = 0.1  # part of the margin that a plan may lack
_OF_TOLERANCE: Final = 0.2  # part of the goal's tolerance within which a plan on trial ends
_LESS_SLACK: Final = 0.5  # part of a plan's slack with which a later one is followed all the same
_RESERVE: Final = 0.01
"""Part of its time that an earlier plan can do without: with none, each error of the odometry makes
the next plan impossible, and its subproblem is one with nearly all wheel speeds at their limits."""


@dataclass
class ArrivalTime:
    """Search for the earliest final time."""

    settings: LawSettings
    stride: float = _LONGEST  # by how much the next trial is earlier, a fraction of the time left
    delay: float = _DELAY  # by how much the first trial of a flawed plan is later, likewise
    sets_out: bool = True  # true if no plan to the goal was made yet
    slack: float = 0.0  # slack that plans need at any time: a gap is too narrow [m]
    trials: int = _TRIALS  # number of trials after the command

    def set_out(
        self, selector: PlanSelector, context: PlanningContext, selected: Candidate
    ) -> tuple[PlanningContext, Candidate]:
        """The plan to follow instead of the first one to a goal, and its control step."""
        if self.sets_out:
            self.sets_out = False
            self.stride, self.delay, self.slack = _LONGEST, _DELAY, 0.0
            self.trials = _INITIAL_TRIALS
            tried = [(context, selected)]
            for _ in range(_INITIAL_DELAYS):
                if self._is_good(selected):
                    break
                # A long horizon may take more work than a step has.
                is_long = not selected.result.solved
                context = self._shifted(context, -_INITIAL_DELAY if is_long else _INITIAL_DELAY)
                selected = selector.best(context)
                tried.append((context, selected))
            if self._lacks_space(selected, tried[0][1]):
                context, selected = tried[0]
            elif not self._is_good(selected):
                context, selected = min(tried, key=lambda each: _flaws(each[1]))
        if selected.feasible:
            self.slack = 0.0
        return context, selected

    def another(
        self, selector: PlanSelector, context: PlanningContext, selected: Candidate, latest: int
    ) -> tuple[PlanningContext, Candidate]:
        """An earlier plan and its step, or a later one, until `latest` [ns], after a flaw."""
        if not self._is_good(selected):
            return self._later(selector, context, selected, latest)
        self.delay = _DELAY
        return self._earlier(selector, context, selected)

    def _earlier(
        self, selector: PlanSelector, context: PlanningContext, selected: Candidate
    ) -> tuple[PlanningContext, Candidate]:
        trials, self.trials = self.trials, _TRIALS
        period = to_nanoseconds(self.settings.control_period)

        def accepts(found: Candidate) -> bool:
            is_blind = drives_blind(self.settings, found.plan, context.start)
            is_tight = reserve(found.plan, self.settings.robot.kinematics) < _RESERVE
            return self._is_accurate(found) and not (is_blind or is_tight)

        is_bracketed = False
        for _ in range(trials):
            trial = self._shifted(context, -self.stride)
            if trial.horizon.edges[-1] < trial.horizon.edges[0] + _FEWEST * period:
                break
            found = selector.try_at_another_time(selected.plan, trial, accepts)
            is_better = accepts(found)
            if is_better:
                context, selected = trial, found
            elif self.stride * context.horizon.durations.sum() * NANOSECONDS < self._grid(context):
                break
            # Between a time that is accepted and one that is not, it is sought by bisection.
            is_bracketed = is_bracketed or not is_better
            self.stride = (
                self.stride / 2.0 if is_bracketed else min(_GROWTH * self.stride, _LONGEST)
            )
        return context, selected

    def _later(
        self, selector: PlanSelector, context: PlanningContext, selected: Candidate, latest: int
    ) -> tuple[PlanningContext, Candidate]:
        self.stride = _DELAY

        def accepts(found: Candidate) -> bool:
            return self._is_accurate(found) or self._is_clearly_better(found, selected)

        # Near the goal a part of the time left is hardly any time.
        left = float(context.horizon.durations.sum())
        least = self.settings.control_period / 2.0 / left
        for delay in (self.delay, max(_LONGER * self.delay, least)):
            trial = self._shifted(context, delay)
            if trial.horizon.edges[-1] > latest:
                break
            found = selector.try_at_another_time(selected.plan, trial, accepts)
            if accepts(found) or self._lacks_space(found, selected):
                self.delay = _DELAY
                return trial, found
        self.delay = min(_MORE * self.delay, _LONGEST)
        return context, selected

    def _lacks_space(self, later: Candidate, earlier: Candidate) -> bool:
        """True if a plan needs slack with more time as without; then plans may have so much."""
        before, self.slack = self.slack, later.result.slack
        lacks = not later.feasible and self._is_accurate(later) and self._is_accurate(earlier)
        self.slack = self.slack if lacks else before
        return lacks

    def _grid(self, context: PlanningContext) -> int:
        """Smallest difference of final times [ns]: a waypoint is passed at a control instant."""
        period = to_nanoseconds(self.settings.control_period)
        return period if context.goal.drives_on else period // _GRID

    def _shifted(self, context: PlanningContext, by: float) -> PlanningContext:
        """The control step with a final time that is later by a fraction of the time left.

        No final time is less than half a period after a control instant, which would be left out.
        """
        period, grid = to_nanoseconds(self.settings.control_period), self._grid(context)
        begin, end = context.horizon.edges[[0, -1]].tolist()
        steps = max(round(abs(by) * (end - begin) / grid), 1)
        end += (steps if by > 0.0 else -steps) * grid
        beyond = (end + context.delay) % period
        if beyond < period // 2:
            end += (period // 2 if beyond and by > 0.0 else 0) - beyond
        return replace(context, horizon=remaining(begin, period, end))

    def _is_good(self, candidate: Candidate, tolerances: float = 1.0) -> bool:
        """True if a plan has no flaw but slack that all need, and ends at the goal."""
        margin = _OF_MARGIN * self.settings.safety.margin
        is_tight = candidate.result.slack <= self.slack + margin
        return (
            (candidate.feasible or (candidate.admissible and is_tight))
            and candidate.verdict.worst_margin >= -TOUCHING
            and not candidate.result.brakes_late
            and candidate.reaches_goal(self.settings, tolerances)
        )

    def _is_clearly_better(self, later: Candidate, earlier: Candidate) -> bool:
        """True if a later plan needs hardly half the slack of a plan that needs some."""
        return (
            later.admissible
            and later.verdict.worst_margin >= -TOUCHING
            and not later.result.brakes_late
            and later.result.slack < _LESS_SLACK * earlier.result.slack
        )

    def _is_accurate(self, candidate: Candidate) -> bool:
        """True if a plan on trial may be followed."""
        return self._is_good(candidate, _OF_TOLERANCE)


def _flaws(candidate: Candidate) -> tuple[bool, bool, float]:
    """Flaws of a plan to set out with, the worse ones first."""
    return not candidate.result.solved, not candidate.feasible, candidate.terminal_error
