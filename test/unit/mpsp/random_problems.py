"""Small random problems, and a check of their solutions that shares no code with the method."""

import casadi
import numpy as np
from scipy.optimize import nnls


def random_problem(seed):
    """Statement for `from_casadi` of a problem that need not be convex or feasible, and a guess."""
    rng = np.random.default_rng(seed)
    N, n, r = int(rng.integers(1, 6)), int(rng.integers(1, 4)), int(rng.integers(1, 3))
    m, rows = int(rng.integers(0, min(n, N * r) + 1)), int(rng.integers(0, 3))
    x, u = casadi.SX.sym('x', n), casadi.SX.sym('u', r)
    z = casadi.vertcat(x, u)
    linear = 0.6 * rng.normal(size=(n, n)) @ x + rng.normal(size=(n, r)) @ u
    Q = rng.normal(size=(n + r, n + r))
    Q = 0.5 * (Q + Q.T) + rng.uniform(-1.0, 3.0) * np.eye(n + r)
    cost = 0.5 * casadi.bilin(Q, z, z) + rng.integers(0, 2) * casadi.dot(rng.normal(size=n + r), z)
    stated = {
        'horizon': N, 'x0': rng.normal(size=n), 'x': x, 'u': u,
        'F': linear + rng.uniform(0.0, 0.5) * casadi.sin(rng.normal(size=(n, n + r)) @ z),
        'L': cost + 0.1 * rng.integers(0, 2) * casadi.sum1(z**4),
    }  # fmt: skip
    if m:
        stated['h'] = rng.normal(size=(m, n)) @ x + 0.2 * casadi.sin(x[0])
        stated['target'] = rng.normal(size=m) * rng.integers(0, 2)
    if rows:
        stated['g'] = [
            casadi.dot(rng.normal(size=n + r), z) + 0.3 * casadi.sumsqr(z) - rng.uniform(0.5, 3.0)
            for _ in range(rows)
        ]
    if rng.random() < 0.6:
        stated['lower'], stated['upper'] = -rng.uniform(0.3, 3.0), rng.uniform(0.3, 3.0)
    guess = rng.normal(size=(N + 1, r)) if rng.random() < 0.7 else np.zeros((N + 1, r))
    return stated, guess


def fault(stated, U, tolerance=1e-5):
    """Reason why controls ``(N + 1, r)`` are no local minimum; '' where none is found.

    Everything is a function of the controls alone; multipliers come from non-negative least
    squares.
    """
    J, E, G, V = _condensed(stated)
    v, q = U.ravel(), U.size
    first = [casadi.gradient(J, V), E, casadi.jacobian(E, V), G, casadi.jacobian(G, V)]
    slope, e, E_V, g, G_V = (np.array(part) for part in casadi.Function('first', [V], first)(v))
    slope, e, g = slope.ravel(), e.ravel(), g.ravel()
    lower = np.full(q, stated.get('lower', -np.inf))
    upper = np.full(q, stated.get('upper', np.inf))
    size = 1.0 + np.abs(slope).max()
    if np.abs(e).max(initial=0.0) > 1e-6 or g.max(initial=0.0) > tolerance:
        return 'a constraint is not met'
    if (v < lower).any() or (v > upper).any():
        return 'a bound is not met'
    tight, unit = np.flatnonzero(g > -tolerance), np.eye(q)
    rows = np.vstack([G_V[tight], unit[v > upper - 1e-6], -unit[v < lower + 1e-6]])
    columns = np.hstack([E_V.T, -E_V.T, rows.T])
    y, rest = (
        nnls(columns, -slope, maxiter=10000)
        if columns.size
        else (np.empty(0), np.linalg.norm(slope))
    )
    if rest > 10.0 * tolerance * size:
        return f'stationarity is missed by {rest:.1e}'
    m = len(e)
    w = casadi.SX.sym('w', m + len(g))
    of_rows = np.zeros(len(g))
    of_rows[tight] = y[2 * m : 2 * m + len(tight)]
    lagrangian = J + casadi.dot(w, casadi.vertcat(E, G))
    hessian = casadi.Function('second', [V, w], [casadi.hessian(lagrangian, V)[0]])
    H = np.array(hessian(v, np.concatenate([y[:m] - y[m : 2 * m], of_rows])))
    strong = np.asarray(y[2 * m :]) > tolerance * size
    held = np.vstack([E_V, rows[strong]])
    _, values, right = np.linalg.svd(held) if len(held) else (None, np.empty(0), unit)
    Z = right[np.count_nonzero(values > 1e-9) :].T
    if not Z.shape[1]:
        return ''
    eigenvalues, vectors = np.linalg.eigh(Z.T @ H @ Z)
    way, weak = Z @ vectors[:, 0], rows[~strong]
    may_go = min((weak @ way).max(initial=-1.0), (-weak @ way).max(initial=-1.0)) <= 1e-6
    if may_go and eigenvalues[0] < -tolerance * max(1.0, np.abs(H).max()):
        return f'the cost curves down, by {eigenvalues[0]:.1e}'
    return ''


def _condensed(stated):
    """Cost, terminal error, path constraints and the symbol of the controls."""
    N, x, u = stated['horizon'], stated['x'], stated['u']
    V, X, J, G = casadi.SX.sym('V', u.shape[0], N + 1), casadi.DM(stated['x0']), 0, []
    g = casadi.vertcat(*stated.get('g', []))
    h = stated.get('h', casadi.SX(0, 1)) - casadi.DM(stated.get('target', np.zeros((0, 1))))
    stage = casadi.Function('stage', [x, u], [stated['F'], stated['L'], g, h])
    depends = casadi.which_depends(g, u, 1, True) if 'g' in stated else []
    for k in range(N + 1):
        following, cost, rows, error = stage(X, V[:, k])
        J += cost
        G += [rows[j] for j in range(len(depends)) if k or depends[j]]
        X = following
    flat = casadi.SX.sym('flat', V.numel())
    joint = casadi.Function('joint', [V], [J, error, casadi.vertcat(*G) if G else casadi.SX(0, 1)])
    return *joint(casadi.reshape(flat, V.shape)), flat
