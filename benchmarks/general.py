"""The solver on programs of other sizes than the robot's, beside its predicted work."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from benchmarks.common import BenchError, collector_off, timed
from cmpsp_ros.mpsp import Linearisation
from cmpsp_ros.mpsp.qp import RICCATI_ACTIVE_SET, QPStatus, Subproblem, solve, solve_qp

SIZES = ((3, 2), (6, 2), (12, 4))  # states and controls; the first are the robot's

PROGRAMS = 8  # random programs of each size

_STEPS, _OUTPUTS, _PATH = 50, 2, 4
_RADIUS = 0.95
_ROOM = 3.0


@dataclass(frozen=True)
class GeneralTiming:
    """Programs of one size."""

    states: int  # ``n``
    controls: int  # ``r``
    iterations: float  # median of the iterations, each of which adds one row
    active: float  # median of the rows that are active at the solution
    time: float  # time of one program: the mean of their medians over all runs [us]
    flops: float  # mean for one program, as counted by `flops`


def time_programs(runs: int, progress: Callable[[], None] = lambda: None) -> list[GeneralTiming]:
    """Time random programs of every size, all of them in turn.

    They go through the back end for any problem, without a warm start. It is compiled for a few
    sizes, and a program is filled up to the next one (`compiled_size`).
    """
    programs = [[program(seed, *size) for seed in range(PROGRAMS)] for size in SIZES]
    times = []
    with collector_off():
        for _ in range(runs):
            times.append([[_solution_time(each) for each in of_size] for of_size in programs])
            progress()
    medians = np.median(times, axis=0).mean(axis=1)
    return [_timing(each, float(took)) for each, took in zip(programs, medians, strict=True)]


def program(seed: int, states: int, controls: int) -> Subproblem:
    """A random program of 50 steps, stable, feasible, with bounds, two outputs and four paths.

    Args:
        seed: Seed.
        states: ``n``.
        controls: ``r``.
    """
    rng = np.random.default_rng([seed, states, controls])
    N, K, n, r = _STEPS, _STEPS + 1, states, controls
    A = rng.normal(size=(N, n, n))
    root = rng.normal(size=(K, n, n)) / np.sqrt(n)
    parts = {
        'A': A * (_RADIUS / np.abs(np.linalg.eigvals(A)).max(axis=1))[:, None, None],
        'B': rng.normal(size=(N, n, r)),
        'L_X': rng.normal(size=(K, n)),
        'L_U': rng.normal(size=(K, r)),
        'L_XX': root @ root.transpose(0, 2, 1),
        'L_UX': np.zeros((K, r, n)),
        'L_UU': np.tile(np.eye(r), (K, 1, 1)),
        'output_error': np.zeros(_OUTPUTS),
        'h_X': rng.normal(size=(_OUTPUTS, n)),
        'h_U': np.zeros((_OUTPUTS, r)),
        'g': np.zeros((K, _PATH)),
        'g_X': rng.normal(size=(K, _PATH, n)),
        'g_U': np.zeros((K, _PATH, r)),
    }
    limits = np.full((K, r), -1.0), np.full((K, r), 1.0), np.full(n, np.inf)
    homogeneous = Subproblem(Linearisation(**parts), *limits)
    # Right-hand sides that some controls within the bounds are known to meet.
    dU = rng.uniform(-0.5, 0.5, size=(K, r))
    dX = homogeneous.propagate(dU)
    parts['output_error'] = -homogeneous.terminal(dU, dX)
    parts['g'] = -homogeneous.path(dU, dX) - rng.exponential(_ROOM, size=(K, _PATH))
    parts['g'][0] = -np.inf
    return Subproblem(Linearisation(**parts), *limits)


def flops(N: int, n: int, r: int, l: int, k: int, c: int) -> float:  # noqa: E741 (the paper's l)
    """Additions and multiplications of a factorisation and ``k`` iterations, to leading order.

    - The factorisation takes ``6 n^3 + 8 n^2 r + 4 n r^2 + 2/3 r^3`` a stage: ``P A`` and ``P B``
      ``2 n^3 + 2 n^2 r``, the controls' elimination ``2 n^2 r + 3 n r^2 + 2/3 r^3``, the closed
      loop ``2 n^2 r + n r^2``, the cost to go ``n^3 + n^2 r``, the covariance ``3 n^3 + n^2 r``.
    - An iteration makes one row, which is a sweep over half of the stages on average,
      ``N (n^2 + n r)``; projects it on the span of ``j`` active rows, ``3 j N r``; solves a
      triangular system, ``j^2``; and evaluates all rows once, by a sweep over the stages for the
      states, ``2 n^2 + 4 n r`` each, and one for the rows, ``2 l (n + r)`` each.

    The number of active rows grows evenly to ``c``. Rows that leave are not counted, nor further
    factorisations with active bounds, nor the check of the answer.
    """
    factorisation = N * (6 * n**3 + 8 * n**2 * r + 4 * n * r**2 + 2 / 3 * r**3)
    row, look = N * (n**2 + n * r), N * (2 * n**2 + 4 * n * r + 2 * l * (n + r))
    return factorisation + k * (row + look + 3 * N * r * c / 2 + c**2 / 3)


def _solution_time(each: Subproblem) -> float:
    solve(each, None)
    return timed(solve, each, None)


def _timing(programs: list[Subproblem], took: float) -> GeneralTiming:
    size = programs[0].size
    iterations: list[int] = []
    active: list[int] = []
    work: list[float] = []
    for each in programs:
        solution = solve_qp(each, RICCATI_ACTIVE_SET)
        if solution.status is not QPStatus.SOLVED:
            raise BenchError(f'n = {size.state}, r = {size.control}: a program was not solved')
        rows = (solution.terminal, solution.path, solution.trust, solution.bounds)
        iterations.append(solution.iterations)
        active.append(sum(int(np.count_nonzero(part)) for part in rows))
        sizes = size.horizon, size.state, size.control, size.path
        work.append(flops(*sizes, solution.iterations, active[-1]))
    return GeneralTiming(
        size.state,
        size.control,
        float(np.median(iterations)),
        float(np.median(active)),
        took,
        float(np.mean(work)),
    )
