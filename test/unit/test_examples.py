"""Every example converges from five guesses, and IPOPT finds nothing better near by."""

import importlib
from pathlib import Path

import pytest

from cmpsp_ros.mpsp import Status, from_casadi, solve
from examples.__main__ import NAMES, guesses
from examples.common import ipopt
from examples.further import EXAMPLES


def test_every_file_is_listed():
    files = {path.stem for path in (Path(__file__).parents[2] / 'examples').glob('[a-z]*.py')}
    assert files == {*NAMES, 'common', 'further'}


ALL = [importlib.import_module(f'examples.{name}').EXAMPLE for name in NAMES] + EXAMPLES


@pytest.mark.parametrize('example', ALL, ids=lambda example: example.name)
def test_it_converges(example):
    solution = example.solve()
    assert solution.status is Status.CONVERGED, solution.sentence
    assert solution.is_minimum
    at = solution.iterate
    again = ipopt(example.stated, at.U, at.X, stays=True)
    assert again.cost == pytest.approx(at.evaluation.cost, rel=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize('example', ALL, ids=lambda example: example.name)
def test_it_converges_from_guesses_about_its_own(example):
    problem = from_casadi(**example.stated)
    ends = [solve(problem, guess).status for guess in guesses(example)[1:]]
    assert ends == [Status.CONVERGED] * 4
