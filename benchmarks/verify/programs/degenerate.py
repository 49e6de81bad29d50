"""Programs whose active rows depend on each other, repeat, or are met exactly; some infeasible."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from benchmarks.verify.case import Draft, Program, Rng
from benchmarks.verify.programs.general import (
    Known,
    disturbed,
    random_penalties,
    random_program,
    row_values,
)
from benchmarks.verify.programs.loop import loops, subproblems
from benchmarks.verify.programs.scenario import blocked, ordinary, tangent
from benchmarks.verify.references import clarabel_solve
from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.qp import QPStatus, Subproblem

Change = Callable[[Known, Rng], Subproblem]

_OF_THE_ROBOT = 0.5
_UNTOUCHED = 0.15


def degenerate(rng: Rng) -> Iterator[Draft]:
    """Degenerate programs, hard and relaxed, without end."""
    while True:
        known = known_program(rng)
        if rng.random() < _UNTOUCHED:
            known = _solved(rng, *next(subproblems(tangent, rng)))
        changed = known
        for _ in range(int(rng.integers(1, 3))):
            change = CHANGES[rng.integers(len(CHANGES))]
            about = f'{changed.about}, {change.__name__.replace("_", " ")}'
            changed = Known(about, change(changed, rng), changed.dU)
        yield from hard_and_relaxed(changed, rng)


def hard_and_relaxed(known: Known, rng: Rng) -> Iterator[Draft]:
    """A program in both forms, the warm start from one that is disturbed."""
    subproblem, weights = known.subproblem, random_penalties(known.subproblem, rng)
    before = disturbed(subproblem, rng)
    yield Draft(f'{known.about}, hard', Program(subproblem), Program(before))
    relaxed = Program(subproblem, weights)
    yield Draft(f'{known.about}, relaxed', relaxed, Program(before, weights))


def with_rows(subproblem: Subproblem, rows: tuple[Array, Array, Array]) -> Subproblem:
    """Path constraints ``g (N + 1, l)``, ``g_X`` and ``g_U`` added to those that there are."""
    lin = subproblem.linearisation
    joined = {
        name: np.concatenate([getattr(lin, name), added], axis=1)
        for name, added in zip(('g', 'g_X', 'g_U'), rows, strict=True)
    }
    return replace(subproblem, linearisation=replace(lin, **joined))


def with_outputs(subproblem: Subproblem, rows: tuple[Array, Array, Array]) -> Subproblem:
    """Terminal rows ``output_error (m,)``, ``h_X`` and ``h_U`` added to those that there are."""
    lin = subproblem.linearisation
    joined = {
        name: np.concatenate([getattr(lin, name), added])
        for name, added in zip(('output_error', 'h_X', 'h_U'), rows, strict=True)
    }
    return replace(subproblem, linearisation=replace(lin, **joined))


def repeated_rows(known: Known, rng: Rng) -> Subproblem:
    """Every path row once more, some of them at another scale."""
    lin = known.subproblem.linearisation
    scale = np.where(rng.random(lin.g.shape) < 0.5, 1.0, 10.0 ** rng.uniform(-3, 3, lin.g.shape))
    rows = scale * lin.g, scale[..., None] * lin.g_X, scale[..., None] * lin.g_U
    return with_rows(known.subproblem, rows)


def opposed_rows(known: Known, rng: Rng) -> Subproblem:
    """Path rows and their opposites, both met exactly by the known controls."""
    lin = known.subproblem.linearisation
    _, values = row_values(known.subproblem, known.dU)
    chosen = (rng.random(lin.g.shape) < 0.1) & np.isfinite(lin.g)
    met = np.where(chosen, lin.g - np.where(chosen, values, 0.0), lin.g)
    there = replace(known.subproblem, linearisation=replace(lin, g=met))
    opposite = np.where(chosen, -met, -np.inf)
    return with_rows(there, (opposite, -lin.g_X, -lin.g_U))


def touched_rows(known: Known, rng: Rng) -> Subproblem:
    """Path rows moved until the known controls meet them exactly, some of many at a stage."""
    lin = known.subproblem.linearisation
    _, values = row_values(known.subproblem, known.dU)
    chosen = (rng.random(lin.g.shape) < rng.choice([0.1, 0.5, 1.0])) & np.isfinite(lin.g)
    moved = np.where(chosen, lin.g - np.where(chosen, values, 0.0), lin.g)
    return replace(known.subproblem, linearisation=replace(lin, g=moved))


def touched_bounds(known: Known, rng: Rng) -> Subproblem:
    """Bounds that the known controls meet exactly."""
    low, high = (rng.random(known.dU.shape) < 0.3 for _ in range(2))
    return replace(
        known.subproblem,
        lower=np.where(low, known.dU, known.subproblem.lower),
        upper=np.where(high, known.dU, known.subproblem.upper),
    )


def fixed_controls(known: Known, rng: Rng) -> Subproblem:
    """Controls that have no choice: both bounds at the known one."""
    fixed = rng.random(known.dU.shape) < rng.choice([0.1, 0.6])
    return replace(
        known.subproblem,
        lower=np.where(fixed, known.dU, known.subproblem.lower),
        upper=np.where(fixed, known.dU, known.subproblem.upper),
    )


def empty_rows(known: Known, rng: Rng) -> Subproblem:
    """Rows independent of the controls, met exactly or with slack."""
    K, r = known.dU.shape
    n = len(known.subproblem.trust_radius)
    g = rng.choice([0.0, -1.0, -1e-9, -np.inf], size=(K, 1))
    return with_rows(known.subproblem, (g, np.zeros((K, 1, n)), np.zeros((K, 1, r))))


def repeated_outputs(known: Known, rng: Rng) -> Subproblem:
    """Terminal rows once more, at another scale."""
    lin = known.subproblem.linearisation
    scale = rng.choice([1.0, -2.0, 1e-3, 1e3])
    rows = scale * lin.output_error, scale * lin.h_X, scale * lin.h_U
    return with_outputs(known.subproblem, rows)


def touched_trust_region(known: Known, rng: Rng) -> Subproblem:
    """A trust region that the known controls reach exactly."""
    reached = np.abs(known.subproblem.propagate(known.dU)).max(axis=0)
    chosen = rng.random(reached.shape) < 0.5
    return replace(
        known.subproblem,
        trust_radius=np.where(chosen & (reached > 0.0), reached, known.subproblem.trust_radius),
    )


CHANGES: Final[tuple[Change, ...]] = (
    repeated_rows,
    opposed_rows,
    touched_rows,
    touched_bounds,
    fixed_controls,
    empty_rows,
    repeated_outputs,
    touched_trust_region,
)


def known_program(rng: Rng) -> Known:
    """One of the robot's programs at its solution, or a random one at feasible controls."""
    if rng.random() < _OF_THE_ROBOT:
        return _solved(rng, *next(subproblems(ordinary, rng)))
    return random_program(rng)


def _solved(rng: Rng, about: str, subproblem: Subproblem) -> Known:
    """A program at its solution; where it has none, a random one instead."""
    answer = clarabel_solve(Program(subproblem))
    if answer.status is QPStatus.SOLVED:
        return Known(about, subproblem, answer.dU)
    return random_program(rng)


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
        change = CONTRADICTIONS[rng.integers(len(CONTRADICTIONS))]
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
    """A violated row independent of the controls."""
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
    """A trust region much too small for the terminal rows."""
    radius = np.full(known.subproblem.trust_radius.shape, 10.0 ** rng.uniform(-4.0, -1.0))
    miss = known.subproblem.linearisation.output_error + 1.0
    lin = replace(known.subproblem.linearisation, output_error=miss)
    return replace(known.subproblem, linearisation=lin, trust_radius=radius)


CONTRADICTIONS: Final[tuple[Callable[[Known, Rng], Subproblem], ...]] = (
    contradicting_rows,
    unmet_empty_row,
    contradicting_outputs,
    held_controls,
    narrow_trust_region,
)
