"""A program small enough to be solved by hand, and a back end that can be made to err."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.verify.case import Case, Contestant, Origin, Program
from benchmarks.verify.references import clarabel_solve
from cmpsp_ros.mpsp import Linearisation
from cmpsp_ros.mpsp.qp import Subproblem


@pytest.fixture
def scalar():
    """Makes: reach ``x_1 = 2`` by ``x_1 = u_0`` at cost ``u^2 / 2``, and ``x_1 <= limit``."""

    def make(limit=5.0, lower=-4.0, upper=4.0):
        g = np.array([[-np.inf], [-limit]])
        return Subproblem(
            Linearisation(
                A=np.zeros((1, 1, 1)),
                B=np.ones((1, 1, 1)),
                L_X=np.zeros((2, 1)),
                L_U=np.zeros((2, 1)),
                L_XX=np.zeros((2, 1, 1)),
                L_UX=np.zeros((2, 1, 1)),
                L_UU=np.ones((2, 1, 1)),
                output_error=np.array([-2.0]),
                h_X=np.ones((1, 1)),
                h_U=np.zeros((1, 1)),
                g=g,
                g_X=np.ones((2, 1, 1)),
                g_U=np.zeros((2, 1, 1)),
            ),
            np.full((2, 1), lower),
            np.full((2, 1), upper),
            np.full(1, np.inf),
        )

    return make


@pytest.fixture
def case_of():
    """Makes a case of one program, with the warm start from that program itself."""

    def make(subproblem, penalties=None, before=None):
        program = Program(subproblem, penalties)
        return Case(Origin('test', 0, 0), 'a test', program, before or program)

    return make


@pytest.fixture
def erring():
    """Makes a back end: Clarabel's answer, changed; with a warm start, changed otherwise."""

    def make(change=lambda answer: answer, warmed=None):
        def cold(program):
            return change(clarabel_solve(program))

        def warm(program, before):
            return warmed(clarabel_solve(program))

        return Contestant('erring', cold, None if warmed is None else warm)

    return make


@pytest.fixture
def moved():
    """Makes a change that moves one control of an answer."""

    def make(by):
        def change(answer):
            dU = answer.dU.copy()
            dU[0, 0] += by * (1.0 + np.abs(dU).max())
            return replace(answer, dU=dU)

        return change

    return make
