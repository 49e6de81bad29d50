"""A response of the robot to its commands, and where the robot is driven by it."""

from __future__ import annotations

from typing import NamedTuple

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.prediction.response_functions import SLICES
from cmpsp_ros.robots import with_lag


class Response(NamedTuple):
    """One way in which the robot may respond, and its commands so far.

    Attributes:
        delay: From a command's stamp to its effect [s].
        lag: Time constant of the control behind it [s].
        effective: Control in effect now, shape ``(r,)``.
        pending: Controls until a command given now takes effect, shape ``(K, r)``.
        durations: How long each of them holds, shape ``(K,)`` [s].
    """

    delay: float
    lag: float
    effective: Array
    pending: Array
    durations: Array

    def in_effect(self) -> tuple[Array, Array]:
        """Controls in effect until a command given now reaches the wheels, and their durations."""
        return driven(self.effective.copy(), self.pending, self.durations, self.lag)

    @property
    def settled(self) -> Array:
        """Control in effect when a command given now reaches the wheels, shape ``(r,)``."""
        effective = self.effective.copy()
        driven(effective, self.pending, self.durations, self.lag)
        return effective


class Risk(NamedTuple):
    """How else the robot may respond than plans assume.

    Attributes:
        responses: The quickest possible response, the slowest, and one between; none while odometry
            agrees with settings that know no lag.
        error: Bound of the prediction error that the response in use leaves [m].
        remark: The reason to drive more slowly, in words.
    """

    responses: list[Response]
    error: float
    remark: str


def driven(effective: Array, commands: Array, held: Array, lag: float) -> tuple[Array, Array]:
    """Controls in effect under commands, and how long each holds [s].

    Args:
        effective: In effect at first, shape ``(r,)``; with a lag, those in the end are written
            here.
        commands: Shape ``(K, r)``.
        held: How long each holds, shape ``(K,)`` [s].
        lag: Time constant behind them; 0 for none [s].
    """
    return with_lag(effective, commands, held, lag, SLICES) if lag > 0.0 else (commands, held)
