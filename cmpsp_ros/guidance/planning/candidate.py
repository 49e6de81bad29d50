"""A plan that may be followed: what the iterations made of it, and what the audit says."""

from __future__ import annotations

from typing import NamedTuple

from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.goals import Target
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.safety.audit import TOUCHING, Audit, Verdict
from cmpsp_ros.guidance.settings import LawSettings


class SolveResult(NamedTuple):
    """A plan after its iterations.

    Attributes:
        plan: The plan.
        solved: Whether the subproblem of the last iteration was solved.
        elastic: Whether slack was needed in it.
        slack: Largest violation that the slack stands for [m].
        slack_where: Indices of the path constraints it is in, outer and inner edge first.
        slack_terminal: Whether it is in the terminal constraint.
        iterations: Iterations done.
        qp_iterations: Iterations of the QP back end in the last one.
        active_rows: Constraints active in the last one.
        reason: Status of the last one, in words.
        work: Visits of a stage that the iterations took; 0 if they are not counted.
    """

    plan: Plan
    solved: bool
    elastic: bool
    slack: float
    slack_where: tuple[int, ...]
    slack_terminal: bool
    iterations: int
    qp_iterations: int
    active_rows: int
    reason: str
    work: int = 0


class Candidate(NamedTuple):
    """A plan that may be followed.

    Attributes:
        result: Of its iterations.
        verdict: On it and on the path to its beginning.
        terminal_error: Distance of its end from the goal [m].
        heading_error: Of its last heading from the goal's [rad]; None where any will do.
    """

    result: SolveResult
    verdict: Verdict
    terminal_error: float
    heading_error: float | None

    @classmethod
    def of(cls, result: SolveResult, verdict: Verdict, target: Target) -> Candidate:
        """The candidate that an audited result is."""
        return cls(result, verdict, *target.errors(result.plan.poses[-1]))

    @property
    def plan(self) -> Plan:
        """The plan itself."""
        return self.result.plan

    @property
    def admissible(self) -> bool:
        """Whether it may be followed at all."""
        return self.result.solved and self.verdict.passed

    @property
    def feasible(self) -> bool:
        """Whether it meets every constraint, too."""
        return self.admissible and not self.result.elastic

    @property
    def is_relaxed(self) -> bool:
        """Whether some constraint is not met, now or in the linearised plan."""
        return self.result.elastic or self._begins_too_close

    @property
    def _begins_too_close(self) -> bool:
        return self.verdict.margin < -TOUCHING

    def describe(self, audit: Audit, settings: LawSettings, start: PlanStart) -> str:
        """What to report when it is followed, in a sentence."""
        result, verdict, error = self.result, self.verdict, self.terminal_error
        if result.elastic:
            where = audit.names(result.slack_where, start.world, start.moving)
            parts = [where] if where else []
            ending = ''
            if result.slack_terminal:
                parts.append('the goal')
                off = self.heading_error or 0.0
                turned = (
                    f', {off:.3g} rad off its heading' if off > settings.heading_tolerance else ''
                )
                ending = f' The plan ends {error:.3g} m from the goal{turned}.'
            return (
                f'The constraints contradict each other: {result.slack:.3g} m of slack at'
                f' {" and ".join(parts)}.{ending}'
            )
        if verdict.worst_margin < 0.0:
            how = 'the way begins' if self._begins_too_close else 'later on the plan still comes'
            return (
                f'No slack was needed, but {how} {-verdict.worst_margin:.3g} m too close to'
                f' {verdict.nearest}.'
            )
        if error > settings.goal_tolerance:
            return f'No slack was needed, but the plan still ends {error:.3g} m from the goal.'
        if self.heading_error is not None and self.heading_error > settings.heading_tolerance:
            where = f"{self.heading_error:.3g} rad off the goal's heading"
            return f'No slack was needed, but the plan still ends {where}.'
        return 'The plan meets every constraint.'
