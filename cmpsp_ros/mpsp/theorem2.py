"""The conditions of Theorem 2, which promise Q-linear convergence, checked at a solution."""

from enum import Enum
from typing import NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.models.derivatives import central_differences
from cmpsp_ros.mpsp.problem import Hessian, OptimalControlProblem
from cmpsp_ros.mpsp.qp.dense.condensing import CondensedQP, condense
from cmpsp_ros.mpsp.results import Solution, Status
from cmpsp_ros.mpsp.sqp.lagrangian import control_gradient, costates

ACTIVE_TOLERANCE = 1e-6  # a constraint this near to its limit, in its own units, counts as active

# Figures are relative; between the two of a pair rounding and the error of the solution decide.
_RANK = (1e-12, 1e-8)
_MULTIPLIER = (1e-9, 1e-6)
_DIFFERENCES = 1e-6
_CURVATURE = 1e-10


class Verdict(Enum):
    """Answer to the question whether a condition holds."""

    YES = 'yes'
    NO = 'no'
    CANNOT_TELL = 'cannot tell'


class Condition(NamedTuple):
    """One condition of Theorem 2: number, verdict, and the figure that it is based on.

    The remark explains the figure, and the limits of the verdict.
    """

    name: str
    verdict: Verdict
    figure: float | None
    remark: str


class Theorem2(NamedTuple):
    """The five conditions; `str` gives them as a table."""

    smooth: Condition  # (i), Lipschitz continuous second derivatives of ``J``, ``Y_N`` and ``g``
    convex_cost: Condition  # (ii), ``grad^2 J`` positive definite for all ``U``
    strict_complementarity: Condition  # (iii)(a), positive multipliers of the active constraints
    regular: Condition  # (iii)(b), full column rank of ``G(U*)``
    second_order: Condition  # (iii)(c), Lagrangian curved upward along the null space of ``G(U*)'``

    @property
    def conditions(self) -> tuple[Condition, ...]:
        """All five, in the theorem's order."""
        return tuple(self)

    @property
    def verdict(self) -> Verdict:
        """Verdict on all of them: no where one does not hold, yes where each does."""
        verdicts = {condition.verdict for condition in self}
        if Verdict.NO in verdicts:
            return Verdict.NO
        return Verdict.YES if verdicts == {Verdict.YES} else Verdict.CANNOT_TELL

    def __str__(self) -> str:
        """One line for each condition: number, verdict, figure, remark."""
        lines = []
        for name, verdict, figure, remark in self:
            shown = '' if figure is None else f'{figure:.3g}'
            lines.append(f'{name:<10}{verdict.value:<13}{shown:>10}  {remark}')
        return '\n'.join(lines)


class _Active(NamedTuple):
    """Gradients of equality and active inequality constraints, and multipliers of the latter."""

    G: Array
    multipliers: Array


def check(
    problem: OptimalControlProblem,
    solution: Solution,
    hessian: Hessian = 'exact',
    smooth: bool | None = None,
) -> Theorem2:
    """Check the conditions of Theorem 2 at the point a run has reached.

    The control bounds count among the path constraints ``g``. Conditions (iii) are about a
    solution: where the run has not converged, they are left open, and their figures are those of
    the last iterate.

    Args:
        problem: The problem.
        solution: End of a run on it.
        hessian: Which Hessian of the cost condition (ii) is asked of; ``exact`` is that of the
            stage costs, condensed as in (45), which leaves out how the dynamics curve.
        smooth: Whether condition (i) is known to hold, which numbers do not show; None if not.
    """
    at = solution.iterate
    lower, upper = problem.control_lower - at.U, problem.control_upper - at.U
    qp = condense(problem.linearise(at.X, at.U, hessian), lower, upper)
    active = _active(qp, solution)
    rank, ratio, null_space = _rank(active.G)
    parts = [
        _strict_complementarity(active, solution),
        _regular(active, rank, ratio),
        _second_order(problem, solution, null_space),
    ]
    if solution.status not in {Status.CONVERGED, Status.NOT_A_MINIMUM}:
        parts = [
            part._replace(verdict=Verdict.CANNOT_TELL, remark=f'not converged; {part.remark}')
            for part in parts
        ]
    return Theorem2(_smooth(smooth), _convex_cost(qp, hessian), *parts)


def lagrangian_gradient(problem: OptimalControlProblem, U: Array, solution: Solution) -> Array:
    """Gradient by ``U`` of (63), shape ``(q,)``, with the multipliers of a solution held.

    Without those of the control bounds: these are constant.
    """
    lin = problem.linearise(problem.predict(U), U)
    weights = solution.terminal_multipliers, solution.path_multipliers
    return control_gradient(lin, costates(lin, *weights), *weights).ravel()


def lagrangian_hessian(problem: OptimalControlProblem, solution: Solution) -> Array:
    """Hessian by ``U`` of (63) at the last iterate, by central differences; symmetric, ``(q, q)``.

    All curvature is in it, that of the dynamics and the constraints too. Step ``6e-6 (1 + |U|)``
    for each control: an error of about 1e-10 relative to the fourth derivative of the Lagrangian
    and of 1e-10 of its gradient's parts. Controls at a bound are varied beyond it.
    """
    H = central_differences(lambda U: lagrangian_gradient(problem, U, solution), solution.iterate.U)
    return 0.5 * (H + H.T)


def _active(qp: CondensedQP, solution: Solution) -> _Active:
    path = -qp.g >= -ACTIVE_TOLERANCE
    rho = solution.path_multipliers[qp.path_stage, qp.path_index]
    beta = solution.bound_multipliers.ravel()
    unit = np.eye(len(qp.c))
    at_upper = qp.upper <= ACTIVE_TOLERANCE
    at_lower = -qp.lower <= ACTIVE_TOLERANCE
    G = np.concatenate([qp.S_N, qp.B_C[path], unit[at_upper], -unit[at_lower]]).T
    return _Active(G, np.concatenate([rho[path], beta[at_upper], -beta[at_lower]]))


def _rank(G: Array) -> tuple[int, float, Array]:
    """Rank, smallest over largest singular value, and the null space of ``G'`` as columns.

    Columns are scaled to unit length first: the units of a constraint are arbitrary.
    """
    length = np.linalg.norm(G, axis=0)
    left, values, _ = np.linalg.svd(G / np.where(length > 0.0, length, 1.0))
    rank = int(np.count_nonzero(values > _RANK[1] * values.max(initial=0.0)))
    ratio = float(values.min(initial=np.inf) / values.max(initial=1e-300))
    if G.shape[1] > G.shape[0]:
        ratio = 0.0
    return rank, ratio, left[:, rank:]


def _smooth(known: bool | None) -> Condition:
    if known is None:
        return Condition('(i)', Verdict.CANNOT_TELL, None, 'numbers do not show smoothness')
    verdict = Verdict.YES if known else Verdict.NO
    return Condition('(i)', verdict, None, 'smoothness as stated by the caller')


def _convex_cost(qp: CondensedQP, hessian: Hessian) -> Condition:
    values = np.linalg.eigvalsh(qp.H)
    remark = f'least eigenvalue of the condensed {hessian} Hessian of J at this point'
    if values[0] > _CURVATURE * abs(values[-1]):
        remark += '; not checked for all U'
        return Condition('(ii)', Verdict.CANNOT_TELL, float(values[0]), remark)
    return Condition('(ii)', Verdict.NO, float(values[0]), remark)


def _strict_complementarity(active: _Active, solution: Solution) -> Condition:
    name, count = '(iii)(a)', len(active.multipliers)
    if not count:
        return Condition(name, Verdict.YES, None, 'no inequality is active')
    least = float(active.multipliers.min())
    largest = max(
        float(np.abs(part).max(initial=0.0))
        for part in (active.multipliers, solution.terminal_multipliers)
    )
    verdict = _three_way(least / (largest or 1.0), _MULTIPLIER)
    return Condition(name, verdict, least, f'least multiplier of the {count} active inequalities')


def _regular(active: _Active, rank: int, ratio: float) -> Condition:
    name, columns = '(iii)(b)', active.G.shape[1]
    if not columns:
        return Condition(name, Verdict.YES, None, 'no constraint is active')
    remark = f'smallest over largest singular value of G, rank {rank} of {columns} columns'
    return Condition(name, _three_way(ratio, _RANK), ratio, remark)


def _second_order(
    problem: OptimalControlProblem, solution: Solution, null_space: Array
) -> Condition:
    name = '(iii)(c)'
    if not null_space.shape[1]:
        return Condition(name, Verdict.YES, None, 'the active constraints leave no direction')
    H = lagrangian_hessian(problem, solution)
    values = np.linalg.eigvalsh(null_space.T @ H @ null_space)
    remark = 'least eigenvalue of the Hessian of the Lagrangian on the null space of G'
    error = _DIFFERENCES * float(np.abs(H).max())
    return Condition(name, _three_way(values[0], (-error, error)), float(values[0]), remark)


def _three_way(figure: float, between: tuple[float, float]) -> Verdict:
    """No up to the lower of two limits, yes above the upper one."""
    if figure > between[1]:
        return Verdict.YES
    return Verdict.NO if figure <= between[0] else Verdict.CANNOT_TELL
