"""The answer to a subproblem, whatever has to be done to get one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np

from cmpsp_ros.mpsp.closed_form import has_closed_form, solve_closed_form
from cmpsp_ros.mpsp.curvature import convexify
from cmpsp_ros.mpsp.problem import Hessian
from cmpsp_ros.mpsp.qp import Penalties, QPSolution, QPStatus, solve_qp
from cmpsp_ros.mpsp.sqp.elastic import LEVELS
from cmpsp_ros.mpsp.subproblem import Subproblem


class Answer(NamedTuple):
    """Solution of a subproblem, and what had to be done to get it.

    Attributes:
        subproblem: The program that was solved, with the shift that it needed.
        solution: Its solution, or why there is none.
        elastic: Whether it was solved relaxed.
    """

    subproblem: Subproblem
    solution: QPSolution
    elastic: bool


def answer(
    subproblem: Subproblem, qp: str, hessian: Hessian, penalties: Penalties | None
) -> Answer:
    """Solve a subproblem, relaxed where its constraints contradict each other.

    Args:
        subproblem: The subproblem.
        qp: Name of the back end; not asked where the closed form (35) will do.
        hessian: Which Hessian it has; an ``exact`` one is looked at for curvature beforehand.
        penalties: Weights of the relaxation; None where it may not be relaxed.
    """
    if hessian == 'exact':
        subproblem = convexify(subproblem)
    hard = _with_curvature(subproblem, partial(_solve_hard, qp=qp))
    if hard.solution.status is QPStatus.SOLVED or penalties is None:
        return hard
    found = hard
    for each in _giving_way(penalties):
        found = _with_curvature(hard.subproblem, partial(solve_qp, name=qp, penalties=each))
        if found.solution.status is QPStatus.SOLVED:
            break
    return found._replace(elastic=True)


def _giving_way(penalties: Penalties) -> Iterator[Penalties]:
    """The lightest rows first, as `cmpsp_ros.mpsp.sqp.elastic` has it."""
    both = penalties.terminal, penalties.path
    weights = np.unique(np.concatenate([each.ravel() for each in both]))
    for heaviest in (*weights[: LEVELS - 1], np.inf):
        yield Penalties(*(np.where(each <= heaviest, each, np.inf) for each in both))
        if heaviest >= weights.max(initial=-np.inf):
            return


def _solve_hard(subproblem: Subproblem, qp: str) -> QPSolution:
    if has_closed_form(subproblem):
        return solve_closed_form(subproblem)
    return solve_qp(subproblem, qp)


def _with_curvature(subproblem: Subproblem, solver: Callable[[Subproblem], QPSolution]) -> Answer:
    """Solve a program, once more with its Hessian shifted where curvature is what it lacks.

    Asking for curvature first would cost a factorisation in every iteration, and Hessians that
    are not exact seldom lack it: they are positive semi-definite by construction.
    """
    solution = solver(subproblem)
    if solution.status is QPStatus.FAILED and not subproblem.shift:
        shifted = convexify(subproblem)
        if shifted.shift:
            return Answer(shifted, solver(shifted), False)
    return Answer(subproblem, solution, False)
