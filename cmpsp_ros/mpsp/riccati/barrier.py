"""The rows of a program in the primal-dual interior point, one by one.

A hard row is ``value + slack = 0``, with ``slack * multiplier`` driven to 0. A relaxed one may
exceed 0 at a price, ``value + slack = excess``, and what its multiplier lacks to its cap, its
``room``, is complementary to the excess. An equality is ``value = 0``. The Newton step of each is

    multiplier_step = weight * (miss + value_step),

so that to the rest of the program a row is a quadratic cost of that weight. Each row gives way in
proportion to ``multiplier_step`` (a proximal point method on the multipliers). That bounds the
weights, and with them the rounding, and makes no difference to the solution, where the step
vanishes.

Mehrotra, S.: On the implementation of a primal-dual interior point method. SIAM Journal on
Optimization 2 (1992), 575-601.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.mpsp.jit.compiled import allocation_free
from cmpsp_ros.mpsp.problem import Array

OFF, HARD, RELAXED, EQUAL = 0, 1, 2, 3
"""Kinds of rows; the first one does not apply."""

# Keeps what is positive so when its steps end in rounding.
_TINY = 1e-150
# A multiplier or a room so much smaller than its slack or excess, as distances, is none.
_NONE = 1e-5


class Barrier(NamedTuple):
    """Rows and their Newton steps, all of shape ``(rows,)``.

    Attributes:
        kind: `OFF`, `HARD`, `RELAXED` or `EQUAL`.
        length: Length in the variables of the whitening, 1 where that is 0. A slack over it, and a
            multiplier times it, are both distances there.
        offset: What is subtracted from `multiplier` to have the row's own: the penalty of a
            relaxed terminal row, whose multiplier has either sign.
        value: Left-hand side minus right-hand side.
        slack: Positive.
        multiplier: Positive; of either sign for an equality.
        excess: Positive where relaxed.
        room: Positive where relaxed.
        weight: Curvature that the row adds.
        miss: Value plus what the complementarity asks for.
        slack_goal: What ``slack * multiplier`` shall become, to first order.
        excess_goal: What ``excess * room`` shall become, to first order.
        value_step: Change of the value along the step.
        slack_step: Change of the slack.
        multiplier_step: Change of the multiplier.
        excess_step: Change of the excess.
    """

    kind: NDArray[np.int64]
    length: Array
    offset: Array
    value: Array
    slack: Array
    multiplier: Array
    excess: Array
    room: Array
    weight: Array
    miss: Array
    slack_goal: Array
    excess_goal: Array
    value_step: Array
    slack_step: Array
    multiplier_step: Array
    excess_step: Array


def empty_barrier(rows: int) -> Barrier:
    """Room for so many rows."""
    numbers = (np.zeros(rows) for _ in Barrier._fields[1:])
    return Barrier(np.zeros(rows, np.int64), *numbers)


@allocation_free
def place_row(b: Barrier, row: int, slack: float, cap: float, product: float) -> None:
    """Give a row its first slack and multiplier, their product near the one that is given."""
    b.value_step[row] = b.slack_step[row] = b.multiplier_step[row] = b.excess_step[row] = 0.0
    b.slack[row] = slack
    b.multiplier[row] = product / slack
    if b.kind[row] == EQUAL:
        b.multiplier[row] = 0.0
    elif b.kind[row] == RELAXED:
        if b.offset[row] > 0.0:
            # The row's own multiplier begins at 0.
            b.slack[row] = 2.0 * product / cap
            b.multiplier[row] = 0.5 * cap
        b.multiplier[row] = min(b.multiplier[row], 0.5 * cap)
        b.room[row] = cap - b.multiplier[row]
        b.excess[row] = product / b.room[row]


@allocation_free
def aim(b: Barrier, give: float, product: float, share: float) -> None:
    """Weights, and the misses of a step to a complementary product.

    Args:
        b: The rows.
        give: By how much a unit of multiplier step moves a row, relative to its length squared.
        product: What all products of complementary numbers shall become.
        share: By how much the products of the predicted steps count, which are in `b`.
    """
    for row in range(b.kind.shape[0]):
        kind = b.kind[row]
        if kind == OFF:
            continue
        b.miss[row] = b.value[row]
        if kind == EQUAL:
            b.weight[row] = 1.0 / (give * b.length[row] ** 2)
            continue
        multiplier, step = b.multiplier[row], share * b.multiplier_step[row]
        b.slack_goal[row] = product - b.slack_step[row] * step
        b.miss[row] += b.slack_goal[row] / multiplier
        softness = give * b.length[row] ** 2 + b.slack[row] / multiplier
        if kind == RELAXED:
            b.excess_goal[row] = product + b.excess_step[row] * step
            b.miss[row] -= b.excess_goal[row] / b.room[row]
            softness += b.excess[row] / b.room[row]
        b.weight[row] = 1.0 / softness


@allocation_free
def follow(b: Barrier) -> Any:
    """Steps of all that a row has, from that of its value.

    Returns:
        Reciprocal of the length of step at which the first positive number would become 0, and
        the mean of the products of complementary steps.
    """
    blocking, product, pairs = 0.0, 0.0, 0
    for row in range(b.kind.shape[0]):
        kind = b.kind[row]
        if kind == OFF:
            continue
        step = b.weight[row] * (b.miss[row] + b.value_step[row])
        b.multiplier_step[row] = step
        if kind == EQUAL:
            continue
        slack, multiplier = b.slack[row], b.multiplier[row]
        slack_step = (b.slack_goal[row] - slack * step) / multiplier - slack
        b.slack_step[row] = slack_step
        product += slack_step * step
        pairs += 1
        blocking = max(blocking, -slack_step / slack, -step / multiplier)
        if kind == RELAXED:
            excess, room = b.excess[row], b.room[row]
            excess_step = (b.excess_goal[row] + excess * step) / room - excess
            b.excess_step[row] = excess_step
            product -= excess_step * step
            pairs += 1
            blocking = max(blocking, -excess_step / excess, step / room)
    return blocking, product / max(pairs, 1)


@allocation_free
def advance(b: Barrier, share: float) -> Any:
    """Take a share of the step.

    Returns:
        Mean of all complementary products, and the largest distance by which a row's value is not
        what its slack and excess make of it.
    """
    total, pairs, worst = 0.0, 0, 0.0
    for row in range(b.kind.shape[0]):
        kind = b.kind[row]
        if kind == OFF:
            continue
        b.value[row] += share * b.value_step[row]
        b.multiplier[row] += share * b.multiplier_step[row]
        error = b.value[row]
        if kind != EQUAL:
            b.slack[row] = max(b.slack[row] + share * b.slack_step[row], _TINY)
            b.multiplier[row] = max(b.multiplier[row], _TINY)
            total += b.slack[row] * b.multiplier[row]
            pairs += 1
            error += b.slack[row]
        if kind == RELAXED:
            b.excess[row] = max(b.excess[row] + share * b.excess_step[row], _TINY)
            b.room[row] = max(b.room[row] - share * b.multiplier_step[row], _TINY)
            total += b.excess[row] * b.room[row]
            pairs += 1
            error -= b.excess[row]
        worst = max(worst, abs(error) / b.length[row])
    return total / max(pairs, 1), worst


@allocation_free
def multiplier_of(b: Barrier, row: int, cap: float) -> float:
    """A row's own multiplier: 0 where it is not active, all of its cap where it gives.

    Args:
        b: The rows.
        row: Which one.
        cap: Largest multiplier.
    """
    kind, squared = b.kind[row], b.length[row] ** 2
    if kind == OFF:
        return 0.0
    if kind != EQUAL and b.multiplier[row] * squared <= _NONE * b.slack[row]:
        return -b.offset[row]
    if kind == RELAXED and b.room[row] * squared <= _NONE * b.excess[row]:
        return cap
    if b.offset[row] > 0.0:
        return min(max(b.multiplier[row] - b.offset[row], -cap), cap)
    return min(b.multiplier[row], cap)
