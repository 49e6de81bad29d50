"""Random programs of the general form: any sizes, cross terms, unstable dynamics, mixed rows."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from benchmarks.verify.case import Draft, Program, Rng
from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp import Linearisation
from cmpsp_ros.mpsp.qp import Penalties, Subproblem

# Few pairs of n and r: stage-wise solvers are compiled for each.
_SIZES = ((1, 1), (2, 1), (3, 2), (5, 2), (6, 3), (12, 4))
_MAX_GROWTH = 1e3
_UNRELATED_START = 0.2


class Known(NamedTuple):
    """A subproblem and controls that are known to be feasible, or nearly so."""

    about: str  # description
    subproblem: Subproblem  # the program
    dU: Array  # the controls, shape ``(N + 1, r)``


def general(rng: Rng) -> Iterator[Draft]:
    """Random programs, hard and relaxed, feasible or not, without end."""
    while True:
        known = random_program(rng, room=rng.random() < 0.8)
        subproblem = known.subproblem
        before = disturbed(subproblem, rng)
        weights = random_penalties(subproblem, rng)
        yield Draft(f'{known.about}, hard', Program(subproblem), Program(before))
        relaxed = Program(subproblem, weights)
        yield Draft(f'{known.about}, relaxed', relaxed, Program(before, weights))


def random_program(rng: Rng, *, room: bool = True) -> Known:
    """A random program."""
    N = int(rng.integers(1, 31)) if rng.random() < 0.85 else int(rng.integers(30, 101))
    n, r = _SIZES[rng.integers(len(_SIZES))]
    m, l = int(rng.integers(0, 4)), int(rng.integers(0, 7))  # noqa: E741 (the paper's l)
    K = N + 1
    A = _dynamics(rng, N, n)
    weight = _weights(rng, K, n + r, r)
    h_X = rng.normal(size=(m, n))
    h_U = rng.normal(size=(m, r)) * (rng.random() < 0.5)
    kind = rng.integers(3, size=(K, l))
    g_X = rng.normal(size=(K, l, n)) * (kind != 0)[..., None]
    g_U = rng.normal(size=(K, l, r)) * (kind != 1)[..., None]
    # The first state is known: constraints of the state alone say nothing there.
    applies = rng.random((K, l)) < rng.uniform(0.3, 1.0)
    applies[0] &= kind[0] != 1

    free = Subproblem(
        Linearisation(
            A=A,
            B=rng.normal(size=(N, n, r)),
            L_X=rng.normal(size=(K, n)),
            L_U=rng.normal(size=(K, r)),
            L_XX=np.ascontiguousarray(weight[:, :n, :n]),
            L_UX=np.ascontiguousarray(weight[:, n:, :n]),
            L_UU=np.ascontiguousarray(weight[:, n:, n:]),
            output_error=np.zeros(m),
            h_X=h_X,
            h_U=h_U,
            g=np.where(applies, 0.0, -np.inf),
            g_X=g_X,
            g_U=g_U,
        ),
        np.full((K, r), -np.inf),
        np.full((K, r), np.inf),
        np.full(n, np.inf),
    )
    known = Known(f'random N = {N}, n = {n}, r = {r}, m = {m}, l = {l}', free, _point(rng, K, r))
    return _limited(known, rng, room=room)


def random_penalties(subproblem: Subproblem, rng: Rng) -> Penalties:
    """Weights between 0.1 and 10000, each row its own or all of a kind alike."""
    m, shape = len(subproblem.linearisation.output_error), subproblem.linearisation.g.shape
    spread = float(rng.integers(2))
    size = rng.uniform(-1.0, 4.0)
    terminal = 10.0 ** (size + spread * rng.uniform(-1.0, 1.0, size=m))
    return Penalties(terminal, 10.0 ** (size + spread * rng.uniform(-1.0, 1.0, size=shape)))


def disturbed(subproblem: Subproblem, rng: Rng) -> Subproblem:
    """The same rows with other right-hand sides and gradients: slightly, or unrelated to these."""
    lin = subproblem.linearisation
    size = 3.0 if rng.random() < _UNRELATED_START else 0.02
    values = {
        name: getattr(lin, name) + size * rng.normal(size=getattr(lin, name).shape)
        for name in ('L_X', 'L_U', 'output_error', 'g')
    }
    other = Linearisation(**{**vars(lin), **values})
    lower, upper, trust = subproblem.lower, subproblem.upper, subproblem.trust_radius
    return Subproblem(other, lower, upper, trust)


def row_values(subproblem: Subproblem, dU: Array) -> tuple[Array, Array]:
    """Linearised terminal error ``(m,)`` and path constraints ``(N + 1, l)`` of controls."""
    dX = subproblem.propagate(dU)
    return subproblem.terminal(dU, dX), subproblem.path(dU, dX)


def _dynamics(rng: Rng, N: int, n: int) -> Array:
    """Stable and unstable steps; unstable modes grow a thousandfold at most."""
    A = rng.normal(size=(n, n)) + 0.1 * rng.normal(size=(N, n, n))
    radius = np.abs(np.linalg.eigvals(A)).max(axis=1)[:, None, None]
    fastest = min(1.5, _MAX_GROWTH ** (1.0 / N))
    return np.ascontiguousarray(A / radius * rng.uniform(0.3, fastest))


def _weights(rng: Rng, K: int, both: int, r: int) -> Array:
    """Stage Hessians with cross terms, positive semi-definite, definite in the controls."""
    rank = int(rng.integers(1, both + 1))
    root = rng.normal(size=(K, both, rank)) * 10.0 ** rng.uniform(-1.0, 1.0)
    weight = root @ root.transpose(0, 2, 1)
    least = 10.0 ** rng.uniform(-4.0, 0.0)
    weight[:, both - r :, both - r :] += least * np.eye(r)
    return weight


def _point(rng: Rng, K: int, r: int) -> Array:
    return 10.0 ** rng.uniform(-1.0, 1.0) * rng.normal(size=(K, r))


def _limited(known: Known, rng: Rng, *, room: bool) -> Known:
    """Right-hand sides, bounds and a trust region about the known controls."""
    subproblem, dU = known.subproblem, known.dU
    lin = subproblem.linearisation
    miss, path = row_values(subproblem, dU)
    gap = rng.exponential(size=lin.g.shape) * 10.0 ** rng.uniform(-2.0, 1.0)
    gap[rng.random(gap.shape) < 0.1] = 0.0
    least = 1.0 if room else rng.uniform(0.3, 1.2)
    if not room:
        gap[rng.random(gap.shape) < 0.05] *= -1.0
    size = np.abs(dU).max()
    bounded = rng.random(dU.shape) < rng.choice([0.0, 0.5, 1.0])
    reach = size * rng.exponential(size=(2, *dU.shape))
    dX = np.abs(subproblem.propagate(dU)).max(axis=0)
    radius = dX * rng.uniform(least, 2.0, size=dX.shape) + 1e-3
    trusted = rng.random(dX.shape) < rng.choice([0.0, 0.3])
    g = np.where(np.isfinite(lin.g), -path - gap, -np.inf)
    limits = Linearisation(**{**vars(lin), 'output_error': -miss, 'g': g})
    return known._replace(
        subproblem=Subproblem(
            limits,
            np.where(bounded, dU - reach[0], -np.inf),
            np.where(bounded, dU + reach[1], np.inf),
            np.where(trusted, radius, np.inf),
        )
    )
