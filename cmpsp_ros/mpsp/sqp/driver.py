"""Drives the iteration: provides what it asks for, from a problem and a QP back end."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from cmpsp_ros.mpsp.jit.compiled import entry_for
from cmpsp_ros.mpsp.problem import Array, Dimensions
from cmpsp_ros.mpsp.qp.riccati.active_set import empty_active_set, empty_warm_start
from cmpsp_ros.mpsp.qp.riccati.correction import correct
from cmpsp_ros.mpsp.qp.riccati.solver import solve
from cmpsp_ros.mpsp.sqp.iteration import advance
from cmpsp_ros.mpsp.sqp.workspace import (
    ADD_CURVATURE,
    CORRECT,
    DONE,
    EVALUATE,
    LINEARISE,
    SOLVE_QP,
    START,
    Workspace,
    workspace,
)

_NEVER: Final = 1 << 40


class Driver:
    """One plan's memory, and the loop that improves the plan in it.

    Attributes:
        ws: The workspace. Its `run` has the options before, and the results after.
    """

    ws: Workspace

    def __init__(
        self,
        size: Dimensions,
        penalty_terminal: Array,
        penalty_path: Array,
        trust_radius: Array,
    ) -> None:
        """Make room for plans of some sizes; arguments as of `workspace`."""
        self.ws = ws = workspace(size, penalty_terminal, penalty_path, trust_radius)
        sizes = size.horizon, size.state, size.control, size.output, size.path
        self._active = empty_active_set(*sizes)
        self._warm = empty_warm_start(*sizes), empty_warm_start(*sizes)
        self._advance = entry_for(advance, ws)
        self._solve = entry_for(solve, ws.program, self._active, self._warm[0])
        self._phase, self._level = ws.run['phase'], ws.run['level']
        self._outcome, self._cost = ws.run['outcome'], ws.run['trial_cost']
        self._horizon, self._begun = ws.program.head['horizon'], ws.program.head['begun']

    def forget(self) -> None:
        """Begin the next plan without what is known of the last one."""
        for warm in self._warm:
            warm[0] = 0

    def improve(
        self,
        steps: int,
        over: int,
        evaluate: Callable[[], float],
        linearise: Callable[[], Any],
    ) -> None:
        """Improve the plan in ``ws.trial.U``; the result is in ``ws.now`` and ``ws.run``.

        Args:
            steps: ``N``, at most those there is room for.
            over: How many stages of the last plan's horizon are over.
            evaluate: Predicts along ``trial.U`` and evaluates, into `trial`; returns the cost.
            linearise: Writes the derivatives along `now` into `program`.
        """
        ws = self.ws
        self._horizon[0] = steps
        self._begun[0] += min(over, _NEVER)
        self._phase[0] = START
        while True:
            request = self._advance(ws)
            if request == EVALUATE:
                self._cost[0] = evaluate()
            elif request == SOLVE_QP:
                warm = self._warm[self._level[0] > 0]
                self._outcome[0] = self._solve(ws.program, self._active, warm)
            elif request == LINEARISE:
                linearise()
            elif request == CORRECT:
                correct(ws.program, self._active, ws.trial.output_error, ws.trial.g)
            elif request in (DONE, ADD_CURVATURE):
                return
