"""An orthonormal basis of the active rows, updated row by row.

The rows ``a_j`` in the order of their numbers are ``a_j = sum_i R[i, j] Q_i`` with ``Q_i``
orthonormal and ``R`` upper triangular.
"""

import math
from typing import NamedTuple

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit.compiled import allocation_free, inner
from cmpsp_ros.mpsp.jit.intrinsics import dot

# Fraction of its length that a row must have outside the basis to count as independent.
_INDEPENDENT = 1e-10
# A projection that leaves less than this fraction has lost digits, and is made once more.
_CANCELLED = 0.01


class Basis(NamedTuple):
    """Orthonormal rows ``Q (M, q)`` and upper triangular ``R (M, M)``; callers know how many."""

    Q: Array
    R: Array


@allocation_free
def split(
    basis: Basis, count: int, row: Array, length: int, inside: Array, outside: Array, again: Array
) -> float:
    """Split a row into its part in the span of the basis and the rest.

    `inside` is filled with the coefficients ``Q row`` of the first and `outside` with the second;
    the row is 0 from `length` on, and `again` is scratch. Returns the square of the length of the
    rest, exactly 0 where the row depends on the basis.
    """
    whole = dot(row, row, length)
    for i in range(length):
        outside[i] = row[i]
    for i in range(length, outside.shape[0]):
        outside[i] = 0.0
    if whole == 0.0:
        for j in range(count):
            inside[j] = 0.0
        return 0.0
    for j in range(count):
        inside[j] = dot(basis.Q[j], row, length)
    _subtract(basis, count, inside, outside)
    rest = dot(outside, outside, outside.shape[0])
    if rest < _CANCELLED * _CANCELLED * whole:
        for j in range(count):
            again[j] = dot(basis.Q[j], outside, outside.shape[0])
        _subtract(basis, count, again, outside)
        for j in range(count):
            inside[j] += again[j]
        rest = dot(outside, outside, outside.shape[0])
    if rest > _INDEPENDENT * _INDEPENDENT * whole:
        return rest
    for i in range(outside.shape[0]):
        outside[i] = 0.0
    return 0.0


@allocation_free
def append(basis: Basis, count: int, inside: Array, outside: Array, sign: float) -> None:
    """Add a row, given by its `split` times a sign."""
    length = math.sqrt(dot(outside, outside, outside.shape[0]))
    Q, scale = basis.Q[count], 1.0 / length
    for i in range(outside.shape[0]):
        Q[i] = scale * outside[i]
    for j in range(count):
        basis.R[j, count] = sign * inside[j]
    basis.R[count, count] = sign * length


@allocation_free
def remove(basis: Basis, count: int, index: int, inside: Array, outside: Array) -> float:
    """Take one of the rows out, by plane rotations.

    The `split` of another row is kept up to date; returns the gain of its squared rest.
    """
    R = basis.R
    for j in range(index, count - 1):
        for i in range(j + 2):
            R[i, j] = R[i, j + 1]
    for i in range(index, count - 1):
        length = math.hypot(R[i, i], R[i + 1, i])
        c, s = R[i, i] / length, R[i + 1, i] / length
        for j in range(i, count - 1):
            upper, lower = R[i, j], R[i + 1, j]
            R[i, j] = c * upper + s * lower
            R[i + 1, j] = c * lower - s * upper
        Q, below = basis.Q[i], basis.Q[i + 1]
        for j in range(outside.shape[0]):
            upper, lower = Q[j], below[j]
            Q[j] = c * upper + s * lower
            below[j] = c * lower - s * upper
        upper, lower = inside[i], inside[i + 1]
        inside[i] = c * upper + s * lower
        inside[i + 1] = c * lower - s * upper
    component, Q = inside[count - 1], basis.Q[count - 1]
    for j in range(outside.shape[0]):
        outside[j] += component * Q[j]
    return component * component


@allocation_free
def solve(basis: Basis, count: int, y: Array, x: Array) -> None:
    """Solve ``R x = y``."""
    for i in range(count - 1, -1, -1):
        after = i + 1
        x[i] = (y[i] - dot(basis.R[i, after:], x[after:], count - after)) / basis.R[i, i]


@allocation_free
def solve_transposed(basis: Basis, count: int, y: Array, x: Array) -> None:
    """Solve ``R' x = y``."""
    for i in range(count):
        total = y[i]
        for j in range(i):
            total -= basis.R[j, i] * x[j]
        x[i] = total / basis.R[i, i]


@inner
def _subtract(basis: Basis, count: int, coefficients: Array, row: Array) -> None:
    """Take basis rows times their coefficients out of a row, four at a time."""
    Q, whole = basis.Q, count - count % 4
    for j in range(0, whole, 4):
        c0, c1 = coefficients[j], coefficients[j + 1]
        c2, c3 = coefficients[j + 2], coefficients[j + 3]
        for i in range(row.shape[0]):
            row[i] -= (c0 * Q[j, i] + c1 * Q[j + 1, i]) + (c2 * Q[j + 2, i] + c3 * Q[j + 3, i])
    for j in range(whole, count):
        c0 = coefficients[j]
        for i in range(row.shape[0]):
            row[i] -= c0 * Q[j, i]
