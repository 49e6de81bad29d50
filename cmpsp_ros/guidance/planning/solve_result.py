"""What the iterations of one control step made of a plan."""

from __future__ import annotations

from typing import NamedTuple

from cmpsp_ros.guidance.decision import Plan


class Improvement(NamedTuple):
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
        reason: What the last iteration came to, in words.
        work: Visits of a stage that the iterations took; 0 where nobody counts.
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
