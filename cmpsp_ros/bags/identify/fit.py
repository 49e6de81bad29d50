"""Fit of a response to drives.

The distances and turns from each odometry message to the next are predicted, and compared: as long
as no pose is taken for true, noise does not add up. Of the residuals, whitened by the noise of
odometry, the sum of squares is least; noise and parameters are found in turns.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from cmpsp_ros.bags.identify.drives import Drive
from cmpsp_ros.bags.identify.noise import Noise, Steps, are_jumps, volume, whitened
from cmpsp_ros.bags.identify.response import Response

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

SUM, LAG, RATIO, SCALE, LIMIT = 0, 1, 2, 3, 5
"""Places of parameters: delay with lag, lag, ratio, two scales, and limits that were found."""

_AXES: Final = 2
_SIZES: Final = np.array([0.01, 0.01, 0.1, 0.1, 0.1, 0.1])
"""Sizes of the parameters, to scale steps of the fit."""

_ENOUGH: Final = 1e-6
"""Relative change at which a fit ends."""

_JUMP: Final = 6.0
"""Standard deviations beyond which a step is a jump of odometry, and does not count."""

_MOTOR: Final = 0.02
"""Time constant of a motor behind the lag: standard deviation of what is expected [s]."""

_LONGEST: Final = 1.2
"""Longest delay that is looked for [s]."""

_TIMEOUTS: Final = (math.inf, 0.2, 0.25, 0.5, 0.6, 1.0)
"""Usual times after which robots stop without a command [s]."""

_EVIDENCE: Final = 30.0
"""Fall of the sum of squares by which a limit must prove itself."""


class Model:
    """Predictions for drives, as a function of a vector of parameters."""

    def __init__(
        self,
        drives: Sequence[Drive],
        timeout: float = math.inf,
        limits: Sequence[tuple[int, str]] = (),
    ) -> None:
        """Fix what is not fitted.

        Args:
            drives: What was recorded.
            timeout: Time after which the robot stops without a command [s].
            limits: Limits that are fitted: axis, and field of `Response`.
        """
        self.drives, self.timeout, self.limits = drives, timeout, tuple(limits)
        self.changes = [[each.changes(axis, timeout) for axis in range(_AXES)] for each in drives]
        self.axes = [
            axis for axis in range(_AXES) if any(each[axis][1].any() for each in self.changes)
        ]

    def responses(self, p: Array) -> list[Response]:
        """Responses ahead and turning."""
        found = [
            Response(p[SUM] - p[LAG], p[LAG], p[RATIO], p[SCALE + axis]) for axis in range(_AXES)
        ]
        for (axis, name), value in zip(self.limits, p[LIMIT:], strict=True):
            found[axis] = replace(found[axis], **{name: value})
        return found

    def residuals(self, p: Array) -> list[list[Array]]:
        """Measured minus predicted steps, of each drive and axis."""
        return [
            [each.steps[:, axis] - np.diff(travel) for axis, (travel, _) in enumerate(predicted)]
            for each, predicted in zip(self.drives, self.predict(p), strict=True)
        ]

    def predict(self, p: Array) -> list[list[tuple[Array, Array]]]:
        """Distance and speed at the stamps of odometry, of each drive and axis."""
        responses = self.responses(p)
        return [
            [one.travel(*its, each.stamps) for one, its in zip(responses, changes, strict=True)]
            for each, changes in zip(self.drives, self.changes, strict=True)
        ]


@dataclass(frozen=True)
class Fit:
    """A model with the parameters that fit best.

    Attributes:
        model: The model.
        p: Its parameters.
        noises: Noise of odometry along each axis.
        factors: Of the covariance of steps, of each drive and axis.
        residuals: Whitened, of all drives and axes, and what is expected of motors.
        jacobian: Their derivatives.
    """

    model: Model
    p: Array
    noises: tuple[Noise, ...]
    factors: list[list[Array]]
    residuals: Array
    jacobian: Array

    @property
    def misfit(self) -> float:
        """Sum of squares of the residuals."""
        return float(self.residuals @ self.residuals)

    @property
    def deviance(self) -> float:
        """Minus twice the logarithm of the likelihood; comparable between models."""
        return self.misfit + sum(volume(each) for row in self.factors for each in row)

    def solved(self, start: Array, fixed: Sequence[int] = ()) -> Fit:
        """The best fit of the same weights, from a start on and with some parameters fixed."""
        unknown = [SCALE + axis for axis in range(_AXES) if axis not in self.model.axes]
        free = np.setdiff1d(np.arange(len(start)), [*fixed, *unknown])
        p = start.copy()

        def residuals(values: Array) -> Array:
            p[free] = values
            return _whitened(self.factors, self.model.residuals(p), p)

        lower, upper = np.full(len(p), 1e-3), np.full(len(p), np.inf)
        lower[:LIMIT], upper[:LIMIT] = (-1.0, 1e-4, 0.0, -9.0, -9.0), (3.0, 3.0, 0.9, 9.0, 9.0)
        inside = np.clip(start[free], lower[free] + 1e-9, upper[free])
        sizes, bounds = _SIZES[free.clip(max=LIMIT)], (lower[free], upper[free])
        found = least_squares(
            residuals, inside, bounds=bounds, x_scale=sizes, ftol=_ENOUGH, xtol=_ENOUGH
        )
        jacobian = np.zeros((len(found.fun), len(p)))
        jacobian[:, free] = found.jac
        p[free] = found.x
        return replace(self, p=p.copy(), residuals=found.fun, jacobian=jacobian)

    def steps(self, axis: int) -> Steps:
        """What the model leaves of the steps along an axis."""
        rows = zip(self.model.drives, self.model.residuals(self.p), self.factors, strict=True)
        found = []
        for drive, row, factor in rows:
            jumps = are_jumps(factor[axis])
            off = np.abs(whitened(factor[axis], row[axis])) > _JUMP
            # What follows a jump seems to be one as long as the jump counts.
            jumps[off.argmax()] |= off.any()
            found.append((row[axis], np.diff(drive.stamps), jumps))
        return found

    def weighted(self) -> Fit:
        """The same parameters, with the noise that their residuals have."""
        steps = [self.steps(axis) for axis in range(_AXES)]
        noises = tuple(noise.fitted(each) for noise, each in zip(self.noises, steps, strict=True))
        factors = [
            [
                noise.factor(durations, jumps)
                for noise, (_, durations, jumps) in zip(noises, its, strict=True)
            ]
            for its in zip(*steps, strict=True)
        ]
        return replace(self, noises=noises, factors=factors)


def fit(drives: Sequence[Drive]) -> Fit:
    """Fit one robot to all drives."""
    stops = any(
        bool((np.diff(each.times) > _TIMEOUTS[1])[each.commands[:-1].any(axis=1)].any())
        for each in drives
    )
    timeouts = _TIMEOUTS if stops else _TIMEOUTS[:1]
    best = min(
        (_converged(_begun(Model(drives, each))) for each in timeouts), key=lambda one: one.deviance
    )
    for axis in best.model.axes:
        for name in ('max_acceleration', 'max_speed'):
            limited = [_limited(best, axis, name, part) for part in (0.9, 0.6, 0.35)]
            candidate = min(limited, key=lambda one: one.misfit)
            if candidate.misfit < best.misfit - _EVIDENCE:
                best = _converged(candidate)
    return best


def _limited(found: Fit, axis: int, name: str, part: float) -> Fit:
    """A fit with one limit more, which begins at a part of what was reached."""
    reached = max(reached_by(found)[axis][name == 'max_acceleration'], 1e-2)
    limits = [*found.model.limits, (axis, name)]
    model = Model(found.model.drives, found.model.timeout, limits)
    return replace(found, model=model).solved(np.append(found.p, part * reached))


def reached_by(found: Fit) -> list[tuple[float, float]]:
    """Speed and acceleration that were reached along each axis, as predicted."""
    reached = []
    for axis in range(_AXES):
        speeds = [row[axis][1] for row in found.model.predict(found.p)]
        rates = [
            np.abs(np.diff(each) / np.diff(drive.stamps))
            for each, drive in zip(speeds, found.model.drives, strict=True)
        ]
        reached.append((max(np.abs(each).max() for each in speeds), max(map(np.max, rates))))
    return reached


def _begun(model: Model) -> Fit:
    """A start: the best of many delays, at a lag between them."""
    noise = Noise(3e-3, 1e-2)
    factors = [
        [noise.factor(np.diff(each.stamps), _leaps(each, axis)) for axis in range(_AXES)]
        for each in model.drives
    ]
    best, least = np.empty(0), math.inf
    for delay in np.arange(-0.2, _LONGEST, 0.04):
        p = np.array([delay + 0.1, 0.1, 0.1, 1.0, 1.0])
        residuals, left = model.residuals(p), 0.0
        for axis in model.axes:
            parts = [
                (whitened(f[axis], each.steps[:, axis]), whitened(f[axis], row[axis]))
                for f, each, row in zip(factors, model.drives, residuals, strict=True)
            ]
            seen, off = (np.concatenate(each) for each in zip(*parts, strict=True))
            predicted = seen - off
            p[SCALE + axis] = seen @ predicted / max(predicted @ predicted, 1e-12)
            left += float(np.sum((seen - p[SCALE + axis] * predicted) ** 2))
        if left < least:
            best, least = p, left
    return Fit(model, best, (noise, noise), factors, np.empty(0), np.empty((0, 0)))


def _converged(start: Fit) -> Fit:
    """Alternate between parameters and noise."""
    found = start.solved(start.p)
    for _ in range(3):
        found = found.weighted()
        found = found.solved(found.p)
    return found


def _leaps(drive: Drive, axis: int) -> Flags:
    """Steps that no command explains: odometry has jumped."""
    fastest = np.abs(drive.commands[:, axis]).max()
    leaps: Flags = np.abs(drive.steps[:, axis]) > 5.0 * fastest * np.diff(drive.stamps) + 0.1
    return leaps


def _whitened(factors: list[list[Array]], rows: list[list[Array]], p: Array) -> Array:
    white = [
        whitened(factor, row)
        for of_drive, its in zip(factors, rows, strict=True)
        for factor, row in zip(of_drive, its, strict=True)
    ]
    motor = p[RATIO] * p[LAG] / (1.0 + p[RATIO])
    return np.concatenate([*white, [motor / _MOTOR]])
