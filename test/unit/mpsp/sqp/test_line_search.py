"""The line search on problems in Python, its merit against difference quotients."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from problems import VanDerPol

from cmpsp_ros.mpsp.qp import Subproblem
from cmpsp_ros.mpsp.qp.active_set.records import compiled_size, derivative_arrays, put_derivatives
from cmpsp_ros.mpsp.sqp.line_search import (
    begin_search,
    go_on,
    go_on_corrected,
    merit,
    predicted_reduction,
    update_penalties,
)
from cmpsp_ros.mpsp.sqp.workspace import Request, workspace

# What they call takes long to compile: by one worker.
pytestmark = pytest.mark.xdist_group('riccati')


@dataclass
class Search:
    """A search from some controls, whose merit has one weight for outputs and one for paths."""

    problem: object
    start: np.ndarray
    terminal: float = 7.0
    path: float = 11.0

    def __post_init__(self):
        size = self.problem.size
        n, r = compiled_size(size.state, size.control)
        self.ws = workspace(
            replace(size, state=n, control=r),
            np.full(size.output, self.terminal),
            np.full(size.path, self.path),
            np.full(n, np.inf),
        )
        X = self.problem.predict(self.start)
        linearisation = self.problem.linearise(X, self.start, 'exact')
        free = np.full(self.start.shape, 50.0)
        self.subproblem = Subproblem(linearisation, -free, free, np.full(size.state, np.inf))
        p = self.ws.program
        put_derivatives(derivative_arrays(p.stages, p.path, p.terminal, size), linearisation)
        self.ws.lower[:, : size.control] = self.problem.control_lower
        self.ws.upper[:, : size.control] = self.problem.control_upper
        self.before = self._put(self.ws.now, self.start)
        self.ws.run['cost'] = self.before.cost
        update_penalties(p)

    def _put(self, there, U):
        size, X = self.problem.size, self.problem.predict(U)
        found = self.problem.evaluate(X, U)
        there.U[:, : size.control], there.X[:, : size.state] = U, X
        there.output_error[:], there.g[:] = found.output_error, found.g
        return found

    def value(self, U):
        cost = self._put(self.ws.trial, U).cost
        return merit(self.ws.program, self.ws.trial, cost)

    def predicted(self, dU):
        size, stages = self.problem.size, self.ws.program.stages
        dX = self.subproblem.propagate(dU)
        stages['dU'][:, : size.control], stages['dX'][:, : size.state] = dU, dX
        return predicted_reduction(self.ws.program, self.ws.slack)

    def run(self, dU, promised=None):
        """The step length, and the controls it ends at."""
        run, size = self.ws.run[0], self.problem.size
        predicted = self.predicted(dU)
        run['predicted'] = predicted if promised is None else promised
        self.ws.program.stages['correction_U'] = 0.0
        begin_search(self.ws, 0.0)
        request = Request.EVALUATE
        while request != Request.DONE:
            if request == Request.CORRECT:
                request = go_on_corrected(self.ws)
                continue
            tried = self.ws.trial.U[:, : size.control].copy()
            run['trial_cost'] = self._put(self.ws.trial, tried).cost
            request = go_on(self.ws)
        return run['length'], self.ws.now.U[:, : size.control].copy()

    @property
    def slope(self):
        """Gradient of the cost in the controls."""
        return self.subproblem.condensed.c.reshape(self.start.shape)


def test_a_step_that_is_too_long_is_shortened():
    lengths = set()
    for factor in (0.05, 0.5, 1.0, 2.0):
        search = Search(VanDerPol(horizon=8), np.ones((9, 1)), terminal=0.0)
        length, U = search.run(-factor * search.slope)
        lengths.add(length)
        if length:
            assert search.value(U) < search.value(search.start)
    assert 1.0 in lengths
    assert lengths & {0.5, 0.25, 0.125, 0.0625}


def test_the_best_that_is_lower_is_taken_where_none_keeps_its_promise():
    search = Search(VanDerPol(horizon=8), np.ones((9, 1)), terminal=0.0)
    downhill = -0.05 * search.slope
    _, U = search.run(downhill, promised=1e12)
    tried = [search.value(search.start + 0.5**halvings * downhill) for halvings in range(5)]
    assert search.value(U) == min(tried)


def test_what_is_not_finite_is_never_taken():
    search = Search(VanDerPol(horizon=8), np.zeros((9, 1)))
    length, _ = search.run(np.full((9, 1), 1e200), promised=0.0)
    assert length == 0.0
