"""Driver of the iteration: calls a problem's functions and a QP solver on its requests."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.jit.compiled import (
    address_of,
    allocation_free,
    call,
    call_for_float,
    call_for_int,
    entry_for,
    inner,
    tuple_at,
    words_of,
)
from cmpsp_ros.mpsp.problem import Dimensions, Hessian
from cmpsp_ros.mpsp.qp.active_set.records import MOST_SWEEPS, Space, compiled_size
from cmpsp_ros.mpsp.qp.active_set.solver import correct, solve
from cmpsp_ros.mpsp.qp.active_set.state import (
    ActiveSet,
    Indices,
    WarmStart,
    empty_active_set,
    empty_warm_start,
)
from cmpsp_ros.mpsp.sqp.back_end import BackEnd
from cmpsp_ros.mpsp.sqp.iteration import advance
from cmpsp_ros.mpsp.sqp.workspace import Phase, Request, Workspace, workspace


@inner
def run(
    ws: Workspace,
    active: ActiveSet,
    hard: WarmStart,
    relaxed: WarmStart,
    solver: Indices,
    problem: Indices,
    data: Any,
) -> None:
    """Serve the iteration until it is over, or the Hessian lacks curvature.

    Warm starts are for subproblems without and with slack. `solver` has the addresses of `advance`,
    `solve` and `correct`, `problem` those of predict, evaluate and linearise.
    """
    state, p, now, trial = ws.run[0], ws.program, ws.now, ws.trial
    while True:
        request = call_for_int(solver[0], (ws,))
        if request == Request.EVALUATE:
            call(problem[0], (data, trial.U, trial.X))
            at = (data, trial.X, trial.U, trial.output_error, trial.g)
            state.trial_cost = call_for_float(problem[1], at)
        elif request == Request.LINEARISE:
            call(problem[2], (data, now.X, now.U, p.stages, p.path, p.terminal))
        elif request == Request.SOLVE_QP:
            warm = relaxed if state.level > 0 else hard
            state.outcome = call_for_int(solver[1], (p, active, warm))
        elif request == Request.CORRECT:
            call(solver[2], (p, active, trial.output_error, trial.g))
        else:
            return


@allocation_free
def run_in(memory: Indices, start: int, solver: Indices, problem: Indices, data: Any) -> None:
    """Call `run` by its address, on the tuples at the addresses of a driver's memory."""
    ws, active = tuple_at(memory[0]), tuple_at(memory[1])
    hard, relaxed = tuple_at(memory[2]), tuple_at(memory[3])
    call(start, (ws, active, hard, relaxed, solver, problem, data))


class Functions(NamedTuple):
    """A problem as functions of its data, which may be anything.

    Arrays may be longer than the horizon, whose end ``N`` the data know.
    """

    # ``predict(data, U, X)`` rolls the dynamics (1) out from the initial state (6): fills `X`,
    # shape ``(N + 1, n)``, for controls `U`, shape ``(N + 1, r)``.
    predict: Callable[[Any, Array, Array], None]
    # ``evaluate(data, X, U, output_error, g)`` returns the cost (3), and fills the terminal error
    # (5), shape ``(m,)``, and the path constraints (4), shape ``(N + 1, l)``, ``-inf`` where one
    # does not apply.
    evaluate: Callable[[Any, Array, Array, Array, Array], float]
    # ``linearise(data, X, U, stages, path, terminal)`` fills the derivatives of
    # `cmpsp_ros.mpsp.qp.riccati.program`. Entries that are always 0 need not be written.
    linearise: Callable[..., None]

    def machine_code(self, data: Any, ws: Workspace) -> Functions:
        """Entries of compiled functions, for data of this type, called one by one."""
        predict, evaluate, linearise = _arguments(data, ws)
        return Functions(
            entry_for(self.predict, *predict),
            entry_for(self.evaluate, *evaluate),
            entry_for(self.linearise, *linearise),
        )

    def addresses(self, data: Any, ws: Workspace) -> Indices:
        """Addresses of compiled functions, shape ``(3,)``."""
        predict, evaluate, linearise = _arguments(data, ws)
        return np.array(
            [
                address_of(None, self.predict, *predict),
                address_of(float, self.evaluate, *evaluate),
                address_of(None, self.linearise, *linearise),
            ]
        )

    def entries(self, data: Any, ws: Workspace) -> Entries:
        """Compiled functions in one piece with the iteration, for data of this type."""
        addresses = self.addresses(data, ws)
        _, active, warm = _examples(*ws.program.stages['B'].shape[1:])
        whole = address_of(None, run, ws, active, warm, warm, addresses, addresses, data)
        enter = entry_for(run_in, addresses, whole, addresses, addresses, data)
        return Entries(self.machine_code(data, ws), addresses, whole, enter)


def _arguments(data: Any, ws: Workspace) -> tuple[tuple[Any, ...], ...]:
    """Arguments of each of the functions."""
    at, p = ws.trial, ws.program
    return (
        (data, at.U, at.X),
        (data, at.X, at.U, at.output_error, at.g),
        (data, at.X, at.U, p.stages, p.path, p.terminal),
    )


class Entries(NamedTuple):
    """A compiled problem: functions to be called one by one, their addresses, and `run` for it."""

    functions: Functions
    addresses: Indices
    run: int  # address
    run_in: Callable[..., None]


@cache
def _examples(n: int, r: int) -> tuple[Workspace, ActiveSet, WarmStart]:
    """Memory of the types that compiled code has for ``n`` states and ``r`` controls."""
    ws = workspace(Dimensions(1, n, r, 1, 1), np.ones(1), np.ones(1), np.full(n, np.inf))
    return ws, empty_active_set(1, n, r, 1, 1), empty_warm_start(1, n, r, 1, 1)


@cache
def _advance_for(n: int, r: int) -> Callable[[Workspace], int]:
    return entry_for(advance, _examples(n, r)[0])


@cache
def _solver_addresses(n: int, r: int) -> tuple[int, int, int]:
    """Addresses of `advance`, `solve` and `correct`."""
    ws, active, warm = _examples(n, r)
    at = ws.trial
    return (
        address_of(int, advance, ws),
        address_of(int, solve, ws.program, active, warm),
        address_of(None, correct, ws.program, active, at.output_error, at.g),
    )


class Results(NamedTuple):
    """Integers that came of an improvement."""

    outcome: int  # `Outcome` of the last subproblem
    level: int  # its relaxation level; 0 without slack
    iterations: int  # done
    active_rows: int  # constraints active in the last subproblem
    qp_iterations: int  # iterations of the compiled solver in it
    work: int  # visits of a stage


class Driver:
    """One plan's memory, and the loop that improves the plan in it.

    `ws.run` has the options before, and the results after; `back_end` is None for the compiled
    solver.
    """

    ws: Workspace
    space: Space
    back_end: BackEnd | None

    def __init__(
        self,
        size: Dimensions,
        penalty_terminal: Array,
        penalty_path: Array,
        trust_radius: Array,
        back_end: tuple[str, Hessian] | None = None,
        *,
        exact: bool = False,
    ) -> None:
        """Make room for plans of some sizes; arguments as of `workspace`.

        Args:
            size: Dimensions.
            penalty_terminal: Shape ``(m,)``.
            penalty_path: Shape ``(l,)``.
            trust_radius: Shape ``(n,)``.
            back_end: Name of a QP back end, and the kind of Hessian that the problem's functions
                give; the compiled solver without.
            exact: No padding to sizes that code may have been compiled for already, with states and
                controls that stay 0: the first answer comes ten seconds later, and each is faster.
        """
        n, r = size.state, size.control
        if not exact:
            n, r = compiled_size(n, r)
        filled = replace(size, state=n, control=r)
        radius = np.concatenate([trust_radius, np.full(n - size.state, np.inf)])
        self.ws = ws = workspace(filled, penalty_terminal, penalty_path, radius)
        added = range(size.control, r)
        ws.program.stages['L_UU'][:, added, added] = 1.0
        sizes = size.horizon, n, r, size.output, size.path
        self._active = empty_active_set(*sizes)
        self._warm_hard, self._warm_relaxed = empty_warm_start(*sizes), empty_warm_start(*sizes)
        self._advance = _advance_for(n, r)
        self.back_end = None
        if back_end is None:
            self._addresses = np.array(_solver_addresses(n, r))
            memory = ws, self._active, self._warm_hard, self._warm_relaxed
            self._words = [np.array(words_of(each)) for each in memory]
            self._memory = np.array([each.ctypes.data for each in self._words])
        else:
            ws.program.head['work_limit'] = MOST_SWEEPS * (size.horizon + 1)
            self.space = Space(size, ws.program, self._active, self._warm_hard)
            warm = () if exact else (self._warm_hard, self._warm_relaxed)
            self.back_end = BackEnd(*back_end, self.space, warm)
        self._phase, self._level = ws.run['phase'], ws.run['level']
        self._outcome, self._cost = ws.run['outcome'], ws.run['trial_cost']
        head = ws.program.head
        self._horizon, self._begun = head['horizon'], head['begun']
        # Single fields are read faster by views than out of a record.
        self._counted = [
            self._outcome,
            self._level,
            ws.run['iterations'],
            ws.run['active_rows'],
            head['iterations'],
            head['work'],
        ]

    @property
    def results(self) -> Results:
        """Results of the last `improve`."""
        return Results(*[each.item() for each in self._counted])

    def forget(self) -> None:
        """Begin the next plan without a warm start."""
        self._warm_hard.clear()
        self._warm_relaxed.clear()

    def improve(self, functions: Functions | Entries, data: Any, steps: int, over: int) -> None:
        """Improve the plan in ``ws.trial.U``, `steps` = ``N``; results in ``ws.now``, ``ws.run``.

        Compiled functions come by their `Functions.entries`; others need a back end. `over` stages
        of the last horizon are over. The compiled solver ends where the condensed Hessian is not
        positive definite.
        """
        self._horizon[0] = steps
        self._begun[0] += over
        self._phase[0] = Phase.START
        self.go_on(functions, data)

    def go_on(self, functions: Functions | Entries, data: Any) -> None:
        """Go on from the phase that the workspace is in; arguments as of `improve`."""
        if isinstance(functions, Entries):
            if self.back_end is None:
                _, problem, run, run_in = functions
                run_in(self._memory, run, self._addresses, problem, data)
                return
            functions = functions.functions
        ws, trial, now, program = self.ws, self.ws.trial, self.ws.now, self.ws.program
        predict, evaluate, linearise = functions
        advance, outcome, cost = self._advance, self._outcome, self._cost
        back_end = self.back_end
        assert back_end is not None  # noqa: S101 (functions that are not compiled have one)
        while True:
            request = advance(ws)
            if request == Request.EVALUATE:
                predict(data, trial.U, trial.X)
                cost[0] = evaluate(data, trial.X, trial.U, trial.output_error, trial.g)
            elif request == Request.LINEARISE:
                linearise(data, now.X, now.U, program.stages, program.path, program.terminal)
                back_end.begin()
            elif request == Request.SOLVE_QP:
                outcome[0] = back_end.solve(self._level[0])
            elif request == Request.ADD_CURVATURE:
                back_end.add_curvature()
            elif request == Request.CORRECT:
                back_end.correct(trial.output_error, trial.g)
            else:
                return
