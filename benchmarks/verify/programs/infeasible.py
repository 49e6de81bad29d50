"""Programs without a solution, by much or by little."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from benchmarks.verify.case import Draft, Rng
from benchmarks.verify.programs.degenerate import (
    hard_and_relaxed,
    known_program,
    with_outputs,
    with_rows,
)
from benchmarks.verify.programs.general import Known, row_values
from benchmarks.verify.programs.loop import loops
from benchmarks.verify.programs.scenario import blocked
from cmpsp_ros.mpsp.qp import Subproblem

_BLOCKED = 0.5


def infeasible(rng: Rng) -> Iterator[Draft]:
    """Blocked tasks of the robot, and programs with rows that contradict, without end."""
    tasks = loops(blocked, rng)
    while True:
        if rng.random() < _BLOCKED:
            yield next(tasks)
            yield next(tasks)
            continue
        known = known_program(rng)
        change = CHANGES[rng.integers(len(CHANGES))]
        about = f'{known.about}, {change.__name__.replace("_", " ")}'
        yield from hard_and_relaxed(Known(about, change(known, rng), known.dU), rng)


def contradicting_rows(known: Known, rng: Rng) -> Subproblem:
    """A row that wants one thing at the known controls, and a row that wants the opposite."""
    K, r = known.dU.shape
    n = len(known.subproblem.trust_radius)
    g_X, g_U = rng.normal(size=(K, 1, n)), rng.normal(size=(K, 1, r))
    g = np.full((K, 1), -np.inf)
    g[rng.integers(K)] = 0.0
    g_X[0] = 0.0
    single = with_rows(known.subproblem, (g, g_X, g_U))
    value = row_values(single, known.dU)[1][:, -1:]
    gap = 10.0 ** rng.uniform(-5.0, 1.0)
    rows = (
        np.concatenate([-value + gap, np.where(np.isfinite(value), value + gap, -np.inf)], axis=1),
        np.concatenate([g_X, -g_X], axis=1),
        np.concatenate([g_U, -g_U], axis=1),
    )
    g = np.where(np.isfinite(value), rows[0], -np.inf)
    return with_rows(known.subproblem, (g, rows[1], rows[2]))


def unmet_empty_row(known: Known, rng: Rng) -> Subproblem:
    """A row that nothing moves and that is not met."""
    K, r = known.dU.shape
    n = len(known.subproblem.trust_radius)
    g = np.full((K, 1), -np.inf)
    g[rng.integers(K)] = 10.0 ** rng.uniform(-5.0, 1.0)
    return with_rows(known.subproblem, (g, np.zeros((K, 1, n)), np.zeros((K, 1, r))))


def contradicting_outputs(known: Known, rng: Rng) -> Subproblem:
    """Terminal rows once more, with another target; where there are none, an empty one."""
    lin = known.subproblem.linearisation
    off = 10.0 ** rng.uniform(-5.0, 1.0)
    if not len(lin.output_error):
        rows = np.full(1, off), np.zeros((1, lin.h_X.shape[1])), np.zeros((1, lin.h_U.shape[1]))
        return with_outputs(known.subproblem, rows)
    return with_outputs(known.subproblem, (lin.output_error + off, lin.h_X, lin.h_U))


def held_controls(known: Known, rng: Rng) -> Subproblem:
    """All controls held where they miss the target and cross the rows that were met."""
    held = known.dU + 10.0 ** rng.uniform(-3.0, 0.0) * rng.normal(size=known.dU.shape)
    return replace(known.subproblem, lower=held, upper=held)


def narrow_trust_region(known: Known, rng: Rng) -> Subproblem:
    """A trust region much too small for what the terminal rows want."""
    radius = np.full(known.subproblem.trust_radius.shape, 10.0 ** rng.uniform(-4.0, -1.0))
    miss = known.subproblem.linearisation.output_error + 1.0
    lin = replace(known.subproblem.linearisation, output_error=miss)
    return replace(known.subproblem, linearisation=lin, trust_radius=radius)


CHANGES: Final[tuple[Callable[[Known, Rng], Subproblem], ...]] = (
    contradicting_rows,
    unmet_empty_row,
    contradicting_outputs,
    held_controls,
    narrow_trust_region,
)
