"""Estimate of the robot's response to commands, from predictions compared with odometry.

A response is a delay from a command's stamp to its effect, and a first-order lag behind it. Once
odometry contradicts the one in use, all within the bounds of the settings are tried side by side:
each leads from where odometry was to where it should be now, and the squared distances sum up to
its misfit ``S``. With ``n`` periods and errors of ``sigma`` each, a response is possible as long as

    S - min S <= (5 sigma)^2,   sigma^2 = max(min S, n (2 mm)^2) / (n - 1),

a likelihood-ratio interval of five standard deviations. The likeliest replaces the settings when
they are beyond three and it leaves at most a tenth of their misfit: slip, a push, or wheels that
speed up slowly are no delay. Where the last few periods contradict the settings by the same
measure, those before are forgotten. The jitter is taken from the periods one by one.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.prediction.pending_commands import PendingCommands
from cmpsp_ros.guidance.prediction.response import Response, Risk, put_misfits, settle
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.times import NANOSECONDS, to_nanoseconds
from cmpsp_ros.robots import Robot

_UNNOTICED: Final = 0.002  # error of a prediction that is always allowed for [m]
_EXPLAINS: Final = 0.1  # part of the settings' misfit that a response may leave to replace them
_STAYS: Final = 0.4  # the same once they have been replaced
_SLOWS: Final = 0.05  # error of predictions that slows the robot down, if unexplained [m]
_POSSIBLE: Final = 5.0  # standard deviations up to which a response is possible
_EXPLAINED: Final = 2.0  # standard deviations up to which a response explains one period
_IN_USE: Final = 3.0  # standard deviations up to which the response in use stays
_FORGETTING: Final = 0.95  # weight that a period keeps when the next one with information comes
_RECENT: Final = 0.6  # the same, to notice that the response is another one than before
_DECAY: Final = 0.9  # part of the error bound that is left after a period without such error
_FADING: Final = 0.98  # the same of the jitter, without such a deviation
_STEP: Final = 0.01  # distance of the delays that are tried [s]
_LAGS: Final = 12  # number of lags that are tried beside none, evenly spaced
_SETTLED: Final = 10.0  # time constants after which a lag is over
_AS_TOLD: Final = Risk([], 0.0, '')


class ResponseEstimate:
    """The response of one run, seen at its control steps; `delay` [ns] and `lag` [s] are in use."""

    def __init__(self, settings: LawSettings) -> None:
        self.error = 0.0  # bound of the prediction error that the response in use leaves [m]
        self.reconfigure(settings)

    def reconfigure(self, settings: LawSettings) -> None:
        """Begin again with other bounds, if they are others."""
        self._is_checked = settings.safety.max_prediction_error > 0.0 or settings.max_lag > 0.0
        told, tolerance = settings.command_delay, settings.delay_tolerance
        bounds = told, tolerance, settings.max_lag
        if bounds == getattr(self, '_bounds', None):
            return
        self._bounds, self._told_delay = bounds, to_nanoseconds(told)
        self._with_lag = settings.max_lag > 0.0
        longest = told + tolerance if tolerance > 0.0 else 0.0
        longest = settings.max_lag if self._with_lag else longest
        lags = np.linspace(0.0, longest, _LAGS + 1) if longest > 0.0 else np.zeros(1)
        steps = math.floor(tolerance / _STEP + 0.5)
        offsets = _STEP * np.arange(-steps, steps + 1)
        grid_offsets, grid_lags = (each.ravel() for each in np.meshgrid(offsets, lags))
        # A delay that is told without a lag includes it.
        delays = told + grid_offsets - (0.0 if self._with_lag else grid_lags)
        # None takes effect before it is given; the rounding of a sum is no reason to leave it out.
        chosen = delays > -_STEP / 2.0
        self._delays, self._lags = np.maximum(delays[chosen], 0.0), grid_lags[chosen].copy()
        self._as_told = np.abs(grid_offsets[chosen]) < _STEP / 2.0
        self._misfits, self._periods = np.zeros(len(self._delays)), 0.0
        self._recent, self._recent_periods = self._misfits, 0.0
        self._found = np.zeros(len(self._delays))
        self._told = int(np.flatnonzero(self._as_told & (self._lags == 0.0))[0])
        self._use(self._told)
        self._jitter = 0.0
        self._possible = self._as_told
        self.lose()

    def lose(self) -> None:
        """Leave out the present control period: its motion is unknown."""
        self._began: tuple[int, Array] | None = None

    @property
    def lag_interval(self) -> tuple[float, float, float] | None:
        """The lag in use, the least possible and the largest [s]; None where none is considered."""
        if not self._with_lag and not self.is_corrected:
            return None
        lags = self._lags[self._possible]
        return self.lag, float(lags.min()), float(lags.max())

    @property
    def delay_interval(self) -> tuple[float, float, float] | None:
        """Delay plus lag: in use, least and largest possible [s]; None while settings hold."""
        if not self.is_corrected:
            return None
        totals = (self._delays + self._lags)[self._possible]
        return self.delay / NANOSECONDS + self.lag, float(totals.min()), float(totals.max())

    def _chosen(self) -> NDArray[np.intp]:
        """Numbers of the quickest possible response, the slowest, and one between."""
        numbers = np.flatnonzero(self._possible)
        totals = self._delays[numbers] + self._lags[numbers]
        order = numbers[np.argsort(totals, kind='stable')]
        first = 0
        if not self.is_corrected and order[0] == numbers[0] and not self._lags[order[0]]:
            # Plans are checked without lag.
            order = order[1:]
            first = max(len(order) // 3 - 1, 0)
        middle = (first + len(order)) // 2
        return order[[first, min(middle, len(order) - 1), -1]] if len(order) else order

    def risk(self, stamp: int, commands: PendingCommands) -> Risk:
        """Responses other than the one that plans assume, at `stamp` [ns]."""
        if not (self._with_lag or self.is_corrected):
            if self.error <= _SLOWS:
                return _AS_TOLD
            return Risk([self.in_use(stamp, commands)], self.error, self._remark)
        numbers = self._chosen()
        delays, lags = self._delays[numbers], self._lags[numbers]
        if len(numbers):
            delays[0], delays[-1] = max(delays[0] - self._jitter, 0.0), delays[-1] + self._jitter
        responses = [
            self.response(stamp, commands, delay, lag)
            for delay, lag in zip(delays.tolist(), lags.tolist(), strict=True)
        ]
        remark = self._remark if self.is_corrected else 'its wheels may lag.'
        return Risk(responses, self.error, remark)

    @property
    def _remark(self) -> str:
        return f'predictions have been wrong by {self.error:.2g} m.'

    def response(self, stamp: int, commands: PendingCommands, delay: float, lag: float) -> Response:
        """A response with delay and lag [s], and the commands up to `stamp` [ns]."""
        nanoseconds = to_nanoseconds(delay)
        pending, durations = commands.until(stamp, nanoseconds)
        effective = commands.in_force
        if lag > 0.0:
            times, controls = commands.before(stamp, self._earliest(stamp))
            effective = np.empty(controls.shape[1])
            settle(effective, 0.0, times, controls, delay, lag)
        return Response(delay, lag, effective, pending, durations)

    def in_use(self, stamp: int, commands: PendingCommands) -> Response:
        """The response in use, as `response`."""
        return self.response(stamp, commands, self.delay / NANOSECONDS, self.lag)

    def warnings(self) -> list[str]:
        """Parameters to be set otherwise, in sentences; none while odometry agrees with them."""
        if self.delay_interval is None:
            if self.error <= _SLOWS:
                return []
            return [
                f'Odometry is up to {self.error:.2g} m from its predictions, and no delay explains'
                ' it: is it robot.max_wheel_acceleration, robot.wheel_radius or slip?'
            ]
        found, least, longest = self.delay_interval
        told, tolerance, max_lag = self._bounds
        bounded = '' if found < told + tolerance + max_lag - _STEP / 2.0 else ', its upper bound'
        return [
            f'Commands take effect after {found:.3f} s ({least:.3f} to {longest:.3f}){bounded},'
            f' by odometry: command_delay is {told:.3g} s.'
        ]

    def update(
        self, stamp: int, pose: Array, commands: PendingCommands, robot: Robot, slip: float
    ) -> None:
        """Compare odometry ``(3,)`` [m, m, rad] at `stamp` [ns] with its prediction."""
        began, self._began = self._began, (stamp, pose)
        if began is None or not self._is_checked:
            return
        predicted = commands.pose_after(began[1], began[0], stamp, self.delay, 1.0 - slip)
        x, y, heading = pose.tolist()
        turned = math.remainder(predicted[2] - heading, math.tau)
        # The heading counts by what it moves a wheel.
        error = math.hypot(predicted[0] - x, predicted[1] - y, robot.half_track * turned)
        if error > 2.0 * robot.kinematics.max_speed * (stamp - began[0]) / NANOSECONDS + _UNNOTICED:
            # No response to commands has made it: odometry has jumped.
            return
        if error > _UNNOTICED or self._with_lag or self._periods:
            error = self._try_all(*began, stamp, pose, commands, robot)
        error = max(error, _DECAY * self.error)
        self.error = error if error > _UNNOTICED else 0.0

    def _try_all(
        self,
        began: int,
        before: Array,
        stamp: int,
        pose: Array,
        commands: PendingCommands,
        robot: Robot,
    ) -> float:
        """Try all responses on a control period; the error of the one in use [m]."""
        times, controls = commands.before(stamp, self._earliest(began))
        found, duration = self._found, (stamp - began) / NANOSECONDS
        arguments = (
            found,
            self._delays,
            self._lags,
            times,
            controls,
            duration,
            np.ascontiguousarray(before, np.float64),
            np.ascontiguousarray(pose, np.float64),
            robot.half_track,
            robot.kinematics,
            np.empty((2, 3)),
            np.empty((1, controls.shape[1])),
            np.empty(controls.shape[1]),
        )
        put_misfits(*arguments)
        # Where all responses lead to the same place, it says nothing about them.
        if float(found.max() - found.min()) > _UNNOTICED**2:
            self._misfits = _FORGETTING * self._misfits + found
            self._periods = _FORGETTING * self._periods + 1.0
            self._recent = _RECENT * self._recent + found
            self._recent_periods = _RECENT * self._recent_periods + 1.0
            if self._periods > 1.0:
                variance = _variance(self._misfits, self._periods)
                self._jitter = max(self._deviation(found, variance), _FADING * self._jitter)
                self._choose(variance)
                if self._recent_contradicts():
                    self._misfits, self._periods = self._recent.copy(), self._recent_periods
                    self._choose(_variance(self._misfits, self._periods))
        return math.sqrt(float(found[self._nearest()]))

    def _recent_contradicts(self) -> bool:
        """True where the last periods rule out the delay as told, and those before kept it in use.

        So a command that was lost, or a push, does not spoil the whole run.
        """
        used = self._nearest()
        if self._with_lag or not self._as_told[used] or self._recent_periods <= 1.0:
            return False
        misfit, least = float(self._recent[used]), float(self._recent.min())
        variance = _variance(self._recent, self._recent_periods)
        return least <= _EXPLAINS * misfit and misfit - least > _IN_USE**2 * variance

    def _choose(self, variance: float) -> None:
        """Replace the response in use by the likeliest one where odometry contradicts it."""
        misfits = self._misfits
        least, as_told = float(misfits.min()), float(misfits[self._as_told].min())
        explained = _STAYS if self.is_corrected else _EXPLAINS
        enough = explained * float(misfits[self._told])
        allowed = (1.0 if self.is_corrected else _IN_USE) ** 2 * variance
        if least > enough or as_told - least <= _IN_USE**2 * variance:
            # The settings are likely, or nothing is much likelier: slip, say, is no delay.
            misfits, least = np.where(self._as_told, misfits, math.inf), as_told
            if least > enough and not self._with_lag:
                self._use(self._told)
                self._possible = self._as_told
                return
        self._possible = misfits - least <= _POSSIBLE**2 * variance
        if float(misfits[self._nearest()]) - least > allowed:
            self._use(int(misfits.argmin()))

    def _use(self, number: int) -> None:
        self.delay = to_nanoseconds(float(self._delays[number]))
        self.lag = float(self._lags[number])
        # Whether odometry has contradicted the settings.
        self.is_corrected = self.delay != self._told_delay or (
            self.lag > 0.0 and not self._with_lag
        )

    def _deviation(self, found: Array, variance: float) -> float:
        """By how much the delay in use must change to explain one control period by itself [s]."""
        totals = self._delays + self._lags - (self.delay / NANOSECONDS + self.lag)
        explained = found - float(found.min()) <= _EXPLAINED**2 * variance
        return float(np.abs(totals[explained]).min())

    def _nearest(self) -> int:
        """Number of the response in use."""
        off = np.abs(self._delays - self.delay / NANOSECONDS) + np.abs(self._lags - self.lag)
        return int(off.argmin())

    def _earliest(self, began: int) -> int:
        """Instant before which a command has had its full effect [ns], for any response."""
        longest = float(self._delays.max()) + _SETTLED * float(self._lags.max())
        return began - to_nanoseconds(longest)


def _variance(misfits: Array, periods: float) -> float:
    """Variance of the errors of the likeliest response in so many periods [m^2]."""
    return max(float(misfits.min()), periods * _UNNOTICED**2) / (periods - 1.0)
