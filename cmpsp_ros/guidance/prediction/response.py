"""A response of the robot to its commands, with a delay and a first-order lag.

A command ``u_k`` given at ``t_k`` takes effect at ``e_k = t_k + d``; from then on the control ``w``
in effect obeys ``T dw/dt = u_k - w``. Without a lag it is ``u_k`` at once.
"""

import math
from typing import Final, NamedTuple

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.robots.motion import Kinematics, drive, with_lag

SLICES: Final = 4  # arcs in which the robot is moved while a lagging control approaches one command


class Response(NamedTuple):
    """One way in which the robot may respond, and its commands so far."""

    delay: float  # from a command's stamp to its effect [s]
    lag: float  # time constant of the control behind it [s]
    effective: Array  # control in effect now, shape ``(r,)``
    pending: Array  # controls until a command given now takes effect, shape ``(K, r)``
    durations: Array  # how long each of them holds, shape ``(K,)`` [s]

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
    """Responses of the robot other than the one that plans assume."""

    responses: list[Response]  # quickest, slowest, one between; none while the settings hold
    error: float  # bound of the prediction error that the response in use leaves [m]
    remark: str  # reason to drive more slowly


def driven(effective: Array, commands: Array, held: Array, lag: float) -> tuple[Array, Array]:
    """Controls in effect ``(M, r)`` under commands with a lag [s], and their durations [s]."""
    return with_lag(effective, commands, held, lag, SLICES) if lag > 0.0 else (commands, held)


@allocation_free
def settle(
    effective: Array, instant: float, times: Array, commands: Array, delay: float, lag: float
) -> None:
    """Leave the control in effect at an instant [s] in `effective` ``(r,)``."""
    for a in range(commands.shape[1]):
        effective[a] = commands[0, a]
    for k in range(times.shape[0]):
        since = instant - (times[k] + delay)
        if since >= 0.0:
            part = 1.0 - math.exp(-since / lag) if lag > 0.0 else 1.0
            for a in range(commands.shape[1]):
                effective[a] += part * (commands[k + 1, a] - commands[k, a])


@allocation_free
def put_misfits(
    misfits: Array,  # ``(C,)`` [m^2]
    delays: Array,  # ``(C,)`` [s]
    lags: Array,  # ``(C,)`` [s]
    times: Array,  # as of `settle` ``(K,)`` [s]
    commands: Array,  # as of `settle` ``(K + 1, r)``
    duration: float,  # of the period [s]
    before: Array,  # pose ``(3,)``
    after: Array,  # pose ``(3,)``
    half_track: float,
    robot: Kinematics,
    poses: Array,  # memory ``(2, 3)``
    control: Array,  # memory ``(1, r)``
    effective: Array,  # memory ``(r,)``
) -> None:
    """Squared distance between odometry and where each response leads in a control period."""
    count = times.shape[0]
    for c in range(misfits.shape[0]):
        delay, lag, now = delays[c], lags[c], -duration
        settle(effective, now, times, commands, delay, lag)
        for i in range(3):
            poses[0, i] = before[i]
        latest = 0
        while latest < count and times[latest] + delay <= now:
            latest += 1
        while now < 0.0:
            end = 0.0
            if latest < count:
                end = min(times[latest] + delay, 0.0)
            slices = SLICES if lag > 0.0 else 1
            held = (end - now) / slices
            left = math.exp(-held / lag) if lag > 0.0 else 0.0
            mean = (1.0 - left) * lag / held if lag > 0.0 and held > 0.0 else 0.0
            for _ in range(slices):
                for a in range(control.shape[1]):
                    behind = effective[a] - commands[latest, a]
                    control[0, a] = commands[latest, a] + mean * behind
                    effective[a] = commands[latest, a] + left * behind
                drive(poses, control, 0, held, robot)
                for i in range(3):
                    poses[0, i] = poses[1, i]
            now = end
            latest += 1
        x, y = poses[0, 0] - after[0], poses[0, 1] - after[1]
        # Wrapped into half a turn either way.
        turned = poses[0, 2] - after[2]
        turned -= math.tau * math.floor(turned / math.tau + 0.5)
        misfits[c] = x * x + y * y + (half_track * turned) ** 2
