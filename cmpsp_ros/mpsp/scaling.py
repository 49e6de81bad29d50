"""Automatic scaling: a problem in units of its own, and its results in the user's units again."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.options import Options
from cmpsp_ros.mpsp.problem import Evaluation, Hessian, Linearisation, OptimalControlProblem
from cmpsp_ros.mpsp.results import Iterate, Step

# A state that the guess moves by less than this part of what the controls can reach tells nothing.
_STANDS_STILL = 1e-3
# One that the guess moves by so much more than that diverges along it.
_UNLIKELY = 1e3


@dataclass(frozen=True)
class Scaling:
    """Units of a problem: a number of the user's is that of the scaled problem times its unit.

    Attributes:
        state: Shape ``(n,)``.
        control: Shape ``(r,)``.
        output: Shape ``(m,)``.
        path: Shape ``(l,)``.
        cost: Of ``J``.
    """

    state: Array
    control: Array
    output: Array
    path: Array
    cost: float

    @classmethod
    def of(
        cls,
        problem: OptimalControlProblem,
        options: Options,
        X: Array,
        U: Array,
        lin: Linearisation,
    ) -> Scaling:
        """Units from bounds, guess ``(N + 1, n)`` and ``(N + 1, r)``, and derivatives along it.

        A control's unit is its largest bound, else its largest guess or what moves the output by
        its own unit, if that is more. A state's unit is its size at the start, in the target or
        along the guess, or what the controls can reach soon where it hardly moves. An output's
        unit is the size of its target or of its states at the start. Path constraints have the
        units that make their largest derivative 1, and so has the cost. A change of the user's
        units changes all of them alike, and nothing in the scaled problem. Constraints whose
        penalties are given keep the user's units, in which the penalties compare them.
        """
        size, sizes = problem.size, np.abs(X)
        start, largest = sizes[0], sizes.max(axis=0)
        output = np.maximum(np.abs(problem.target), np.abs(lin.h_X) @ start)
        control = _control_units(problem, U, lin, np.maximum(output, np.abs(lin.output_error)))
        # Over the whole horizon what is unstable would have no scale.
        reach = _reach(lin, control, max(1, len(U) // 4))
        known = np.maximum(start, _asked_for(lin.h_X, problem.target))
        seen = np.maximum(known, np.minimum(largest, _UNLIKELY * np.maximum(known, reach)))
        state = _or_one(np.where(seen > _STANDS_STILL * reach, seen, reach))
        spread = np.abs(lin.h_X) @ state + np.abs(lin.h_U) @ control
        outputs, path = np.ones(size.output), np.ones(size.path)
        if options.penalty_terminal is None:
            outputs = _or_one(np.where(output > 0.0, output, spread))
        if options.penalty_path is None and size.path:
            slopes = np.concatenate([lin.g_X * state, lin.g_U * control], axis=2)
            applies = (lin.g != -np.inf)[:, :, None]
            path = _or_one(
                np.abs(slopes, where=applies, out=np.zeros_like(slopes)).max(axis=(0, 2))
            )
        by_stage = lin.L_X, lin.L_U, lin.L_XX, lin.L_UU
        L_X, L_U, L_XX, L_UU = (np.abs(each).max(axis=0) for each in by_stage)
        parts = (
            L_X * state, L_U * control, L_XX * state * state[:, None],
            L_UU * control * control[:, None],
        )  # fmt: skip
        largest_part = max(float(part.max()) for part in parts)
        is_unit = 0.0 < largest_part < np.inf
        return cls(state, control, outputs, path, largest_part if is_unit else 1.0)

    @classmethod
    def none(cls, problem: OptimalControlProblem) -> Scaling:
        """The user's units."""
        size = problem.size
        return cls(
            np.ones(size.state), np.ones(size.control), np.ones(size.output), np.ones(size.path),
            1.0,
        )  # fmt: skip

    def applied_to(self, problem: OptimalControlProblem) -> OptimalControlProblem:
        """The problem in these units."""
        units = self.state, self.control, self.output, self.path, self.cost
        return problem.in_units(*units) or ScaledProblem(problem, self)

    def options(self, options: Options, problem: OptimalControlProblem) -> Options:
        """Options of the scaled problem.

        Penalties and the trust radius are in the user's units; tolerances are relative to the
        units here, that of the terminal error to the target where this is larger.
        """
        given = options.penalty_terminal, options.penalty_path, options.trust_radius
        terminal, path, radius = (None if each is None else np.asarray(each) for each in given)
        length = float(np.linalg.norm(problem.target)) or 1.0
        return replace(
            options,
            penalty_terminal=None if terminal is None else terminal / self.cost,
            penalty_path=None if path is None else path / self.cost,
            trust_radius=None if radius is None else radius / self.state,
            output_tolerance=options.output_tolerance
            * (max(1.0, 1.0 / length) if terminal is None else 1.0),
        )

    def unscaled(self, at: Iterate) -> Iterate:
        """An iterate of the scaled problem in the user's units."""
        value, step, before = at.evaluation, at.step, at.previous_U
        return replace(
            at,
            U=at.U * self.control,
            X=at.X * self.state,
            evaluation=Evaluation(
                value.cost * self.cost, value.output_error * self.output, value.g * self.path
            ),
            previous_U=None if before is None else before * self.control,
            step=None if step is None else self._unscaled_step(step),
        )

    def _unscaled_step(self, step: Step) -> Step:
        multipliers = step.terminal_multipliers, step.path_multipliers, step.bound_multipliers
        terminal, path, bounds = self.unscaled_multipliers(multipliers)
        return replace(
            step,
            slack_terminal=step.slack_terminal * self.output,
            slack_path=step.slack_path * self.path,
            terminal_multipliers=terminal,
            path_multipliers=path,
            bound_multipliers=bounds,
        )

    def unscaled_multipliers(
        self, scaled: tuple[Array, Array, Array]
    ) -> tuple[Array, Array, Array]:
        """Multipliers of outputs, path constraints and bounds in the user's units."""
        terminal, path, bounds = self._of_multipliers
        return scaled[0] * terminal, scaled[1] * path, scaled[2] * bounds

    @cached_property
    def _of_multipliers(self) -> tuple[Array, Array, Array]:
        return self.cost / self.output, self.cost / self.path, self.cost / self.control

    def __str__(self) -> str:
        """The units in one line."""
        named = ('state', 'control', 'output', 'path')
        parts = [f'{name} {np.array2string(getattr(self, name), precision=3)}' for name in named]
        return f'Units: {", ".join(parts)}, cost {self.cost:.3g}.'


class ScaledProblem(OptimalControlProblem):
    """A problem in other units."""

    def __init__(self, problem: OptimalControlProblem, scaling: Scaling) -> None:
        """Take the problem and its units."""
        self._problem, self._scaling = problem, scaling
        self.size = problem.size
        self.control_lower = problem.control_lower / scaling.control
        self.control_upper = problem.control_upper / scaling.control
        self.target = problem.target / scaling.output

    def predict(self, U: Array) -> Array:
        """States along scaled controls."""
        return self._problem.predict(U * self._scaling.control) / self._scaling.state

    def next_states(self, X: Array, U: Array) -> Array:
        """Dynamics of each stage, as described in `OptimalControlProblem`."""
        unit = self._scaling
        return self._problem.next_states(X * unit.state, U * unit.control) / unit.state

    def evaluate(self, X: Array, U: Array) -> Evaluation:
        """Scaled cost, terminal error and path constraints."""
        unit = self._scaling
        found = self._problem.evaluate(X * unit.state, U * unit.control)
        return Evaluation(
            found.cost / unit.cost, found.output_error / unit.output, found.g / unit.path
        )

    def linearise(self, X: Array, U: Array, hessian: Hessian = 'gauss_newton') -> Linearisation:
        """Derivatives of scaled functions by scaled variables."""
        unit = self._scaling
        x, u, y, g = unit.state, unit.control, unit.output[:, None], unit.path[:, None]
        lin = self._problem.linearise(X * x, U * u, hessian)
        return Linearisation(
            lin.A * x / x[:, None], lin.B * u / x[:, None],
            lin.L_X * x / unit.cost, lin.L_U * u / unit.cost,
            *self._second(lin.L_XX, lin.L_UX, lin.L_UU),
            lin.output_error / unit.output, lin.h_X * x / y, lin.h_U * u / y,
            lin.g / unit.path, lin.g_X * x / g, lin.g_U * u / g,
        )  # fmt: skip

    def constraint_curvature(
        self, X: Array, U: Array, costates: Array, terminal: Array, path: Array
    ) -> tuple[Array, Array, Array]:
        """Second derivatives, as described in `OptimalControlProblem`."""
        unit = self._scaling
        J = unit.cost
        found = self._problem.constraint_curvature(
            X * unit.state, U * unit.control,
            costates * J / unit.state, terminal * J / unit.output, path * J / unit.path,
        )  # fmt: skip
        return self._second(*found)

    def _second(self, XX: Array, UX: Array, UU: Array) -> tuple[Array, Array, Array]:
        x, u, J = self._scaling.state, self._scaling.control, self._scaling.cost
        return XX * x * x[:, None] / J, UX * x * u[:, None] / J, UU * u * u[:, None] / J


def _control_units(
    problem: OptimalControlProblem, U: Array, lin: Linearisation, wanted: Array
) -> Array:
    bounds = np.stack([problem.control_lower, problem.control_upper])
    found = np.abs(np.where(np.isfinite(bounds), bounds, 0.0)).max(axis=(0, 1))
    if not found.all():
        h_X, S_N = lin.h_X, [lin.h_U]
        for A, B in zip(lin.A[::-1], lin.B[::-1], strict=True):
            S_N.append(h_X @ B)
            h_X = h_X @ A
        reach = np.sqrt(np.square(S_N).sum(axis=0))
        for a in np.flatnonzero(found == 0.0):
            helps = (reach[:, a] > 0.0) & (wanted > 0.0)
            needed = (wanted[helps] / reach[helps, a]).min() if helps.any() else 0.0
            found[a] = max(np.abs(U[:, a]).max(), needed)
    return _or_one(found)


def _reach(lin: Linearisation, control: Array, steps: int) -> Array:
    """Change of each state that independent controls of these sizes make within so many steps."""
    B = lin.B[:steps] * control
    squares = B @ B.swapaxes(1, 2)
    for k in range(1, len(squares)):
        squares[k] += lin.A[k].dot(squares[k - 1]).dot(lin.A[k].T)
    found: Array = np.sqrt(squares.diagonal(axis1=1, axis2=2).max(axis=0))
    return found


def _asked_for(h_X: Array, target: Array) -> Array:
    """Value of each state that the target asks for, where an output is of one state alone."""
    is_alone = (h_X != 0.0) & (np.count_nonzero(h_X, axis=1, keepdims=True) == 1)
    found: Array = np.abs(target[:, None] / np.where(is_alone, h_X, np.inf)).max(
        axis=0, initial=0.0
    )
    return found


def _or_one(units: Array) -> Array:
    """Units, 1 where one is 0 or not finite."""
    found: Array = np.where((units > 0.0) & np.isfinite(units), units, 1.0)
    return found
