"""The iteration itself: predict, linearise, solve, search, update (43), without Python between."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from cmpsp_ros.mpsp.jit.compiled import allocation_free, inlined
from cmpsp_ros.mpsp.problem import Array
from cmpsp_ros.mpsp.realtime.functions import evaluate, linearise, predict
from cmpsp_ros.mpsp.realtime.giving_way import RANKS, let_give_way
from cmpsp_ros.mpsp.realtime.merit import promised, weigh
from cmpsp_ros.mpsp.realtime.packed import Packed, unpack
from cmpsp_ros.mpsp.realtime.search import attempt, copy, search
from cmpsp_ros.mpsp.realtime.workspace import Trajectory, Workspace
from cmpsp_ros.mpsp.riccati.outcome import NO_CURVATURE, SOLVED
from cmpsp_ros.mpsp.riccati.rows import count_rows, rows_a_stage
from cmpsp_ros.mpsp.riccati.solver import iterations, solve
from cmpsp_ros.mpsp.riccati.whitening import factorise
from cmpsp_ros.mpsp.riccati.working_set import shift_hint

DONE, OUTCOME, RELAXED, QP_ITERATIONS, ACTIVE_ROWS, FINITE = 0, 1, 2, 3, 4, 5
"""Places in `Workspace.counts`: iterations done; and of the last one its outcome, whether it was
relaxed, the iterations of its solver, its active rows, and whether all numbers were finite."""


class Rules(NamedTuple):
    """How the iteration is run; see `cmpsp_ros.mpsp.iteration.Options`.

    Attributes:
        iterations: Iterations at most.
        line_search: Whether a step is shortened until it lowers the merit.
        output_tolerance: ``eps_Y`` of Sec. 4, absolute.
        control_tolerance: ``eps_U`` of Sec. 4.
        violation_tolerance: Largest path constraint at a solution.
        slack_tolerance: Slack up to which a linearised constraint counts as met.
        growth_limit: Growth of cost or controls from which on a run has diverged.
    """

    iterations: int
    line_search: bool
    output_tolerance: float
    control_tolerance: float
    violation_tolerance: float
    slack_tolerance: float
    growth_limit: float


@allocation_free
def improve(data: Any, packed: Packed, N: int, over: int, rules: Rules) -> None:
    """Improve the plan in a workspace's ``at.U``, as `cmpsp_ros.mpsp.iteration.CMPSP` does.

    Args:
        data: The problem, whose functions are given by `cmpsp_ros.mpsp.realtime.functions`.
        packed: The workspace. Its iterate and counts are the result, on ``N + 1`` stages.
        N: Steps of the horizon, at most those there is room for.
        over: How many stages of the last plan's horizon are over; beyond its end to know nothing of
            the last plan.
        rules: How the iteration is run.
    """
    room = unpack(packed, N)
    _shift_hints(room, over)
    at = room.at
    room.counts[:] = 0
    room.slack[:] = 0.0
    size = 1.0
    for k in range(N + 1):
        for a in range(at.U.shape[1]):
            at.U[k, a] = min(max(at.U[k, a], room.lower[k, a]), room.upper[k, a])
            size = max(size, 1.0 + abs(at.U[k, a]))
    predict(data, at.U, at.X)
    at.cost[0] = evaluate(data, at.X, at.U, at.output_error, at.g)
    cost_limit, control_limit = (
        (1.0 + abs(at.cost[0])) * rules.growth_limit,
        size * rules.growth_limit,
    )
    length = 0.0
    while room.counts[DONE] < rules.iterations:
        length, change = _step(data, room, rules, length)
        room.counts[DONE] += 1
        if _is_over(room, rules, length, change, cost_limit, control_limit):
            return


@inlined
def _shift_hints(room: Workspace, over: int) -> None:
    """Move the active rows of the last plan to the horizon of this one."""
    terminal, width = room.qp.output_error.shape[0], rows_a_stage(room.qp)
    last = count_rows(room.qp)
    shift_hint(room.solver.hint_hard, terminal, over * width, last)
    shift_hint(room.solver.hint_relaxed, terminal, over * width, last)


@inlined
def _step(data: Any, room: Workspace, rules: Rules, last_length: float) -> Any:
    """One iteration; returns the step length taken, and the relative change of the full step."""
    qp, solver, at, counts = room.qp, room.solver, room.at, room.counts
    linearise(data, at.X, at.U, qp)
    for k in range(at.U.shape[0]):
        for a in range(at.U.shape[1]):
            qp.lower[k, a] = room.lower[k, a] - at.U[k, a]
            qp.upper[k, a] = room.upper[k, a] - at.U[k, a]
    counts[QP_ITERATIONS] = 0
    if not factorise(qp, solver.white):
        counts[RELAXED] = 0
        counts[OUTCOME] = NO_CURVATURE
        return 0.0, 0.0
    for trying in range(RANKS + 1):
        hard = let_give_way(room.relaxed, trying, room.most)
        hint = solver.hint_relaxed if trying else solver.hint_hard
        counts[RELAXED] = int(trying > 0)
        counts[OUTCOME] = solve(qp, room.most, hint, solver)
        counts[QP_ITERATIONS] = iterations(solver)
        if counts[OUTCOME] == SOLVED or not hard:
            break
    if counts[OUTCOME] != SOLVED:
        return 0.0, 0.0
    counts[ACTIVE_ROWS] = _active_rows(room)
    change = _sum_of_norms(solver.dU) / (_sum_of_norms(at.U) or 1.0)
    weigh(room)
    if rules.line_search:
        return search(data, room, last_length, counts[RELAXED] == 1), change
    promised(room)
    attempt(data, room, 1.0, False)
    copy(room.trial, at)
    return 1.0, change


@inlined
def _is_over(
    room: Workspace,
    rules: Rules,
    length: float,
    change: float,
    cost_limit: float,
    control_limit: float,
) -> bool:
    """Whether the iteration is over by itself: `cmpsp_ros.mpsp.iteration.CMPSP.terminate`."""
    if room.counts[OUTCOME] != SOLVED or length == 0.0 or not _is_finite(room.at):
        return True
    largest = 0.0
    for k in range(room.at.U.shape[0]):
        for a in range(room.at.U.shape[1]):
            largest = max(largest, abs(room.at.U[k, a]))
    if 1.0 + abs(room.at.cost[0]) > cost_limit or 1.0 + largest > control_limit:
        return True
    if change > rules.control_tolerance:
        return False
    return needs_slack(room, rules) or _is_met(room.at, rules)


@allocation_free
def needs_slack(room: Workspace, rules: Rules) -> bool:
    """Whether the relaxation of the last subproblem left a violation."""
    if room.counts[RELAXED] == 0:
        return False
    largest = 0.0
    for j in range(room.slack.shape[0]):
        largest = max(largest, room.slack[j])
    return largest > rules.slack_tolerance


@allocation_free
def _is_met(at: Trajectory, rules: Rules) -> bool:
    miss = 0.0
    for j in range(at.output_error.shape[0]):
        miss += at.output_error[j] ** 2
    if math.sqrt(miss) > rules.output_tolerance:
        return False
    for k in range(at.g.shape[0]):
        for j in range(at.g.shape[1]):
            if at.g[k, j] > rules.violation_tolerance:
                return False
    return True


@allocation_free
def _is_finite(at: Trajectory) -> bool:
    total = at.cost[0]
    for k in range(at.X.shape[0]):
        for i in range(at.X.shape[1]):
            total += 0.0 * at.X[k, i]
    return math.isfinite(total)


@inlined
def _active_rows(room: Workspace) -> int:
    """Inequalities with a multiplier."""
    multipliers = room.solver.multipliers
    return _count(multipliers.path) + _count(multipliers.trust) + _count(multipliers.bounds)


@allocation_free
def _count(of: Array) -> int:
    count = 0
    for number in of.reshape(of.size):
        count += int(number != 0.0)
    return count


@allocation_free
def _sum_of_norms(U: Array) -> float:
    """``sum |U_k|``, the measure of ``eps_U`` in Sec. 4."""
    total = 0.0
    for k in range(U.shape[0]):
        squared = 0.0
        for a in range(U.shape[1]):
            squared += U[k, a] ** 2
        total += math.sqrt(squared)
    return total
