"""Ways to do one control step: two iterations on a horizon, from a warm start."""

from __future__ import annotations

from typing import Protocol

from cmpsp_ros.arrays import Array

ITERATIONS = 2
"""Iterations of a control step."""

PENALTY = 1e4
"""Largest multiplier of a row that is relaxed because no point meets all of them."""


class Method(Protocol):
    """One way to do a control step.

    Attributes:
        name: For tables and pictures.
        largest: Longest horizon that it is worth being asked for [steps].
    """

    name: str
    largest: int

    def prepare(self, steps: int) -> None:
        """Do once what can be done before a horizon of so many steps is known any better."""

    def begin(self, steps: int) -> None:
        """Forget what earlier steps have left behind: a new run of so many steps begins."""

    def step(self, pose: Array, U: Array, durations: Array) -> Array:
        """Improve a control history; this alone is timed.

        Args:
            pose: Where the robot is, shape ``(3,)`` [m, m, rad].
            U: Warm start, shape ``(N + 1, 2)`` [rad/s]; to be left as it is.
            durations: Lengths of the steps, shape ``(N,)`` [s].

        Returns:
            Controls, shape ``(N + 1, 2)`` [rad/s].

        Raises:
            BenchError: It cannot.
        """
