"""Every example converges from its own guess, and IPOPT finds nothing better near by."""

import importlib
from pathlib import Path

import pytest

from cmpsp_ros.mpsp import Status
from examples.__main__ import NAMES
from examples.common import ipopt


def test_every_file_is_listed():
    files = {path.stem for path in (Path(__file__).parents[2] / 'examples').glob('[a-z]*.py')}
    assert files == {*NAMES, 'common'}


@pytest.mark.parametrize('name', NAMES)
def test_it_converges(name):
    example = importlib.import_module(f'examples.{name}').EXAMPLE
    solution = example.solve()
    assert solution.status is Status.CONVERGED, solution.sentence
    assert solution.is_minimum
    at = solution.iterate
    again = ipopt(example.stated, at.U, at.X, stays=True)
    assert again.cost == pytest.approx(at.evaluation.cost, rel=1e-5)
