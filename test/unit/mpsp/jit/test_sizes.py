"""A function of records is translated once for all sizes, and right for each."""

import re

import numpy as np
import pytest

from cmpsp_ros.mpsp.jit import allocation_free, compilations
from cmpsp_ros.mpsp.jit.intrinsics import room_for
from cmpsp_ros.mpsp.qp.riccati.program import empty_program

SIZES = ((1, 1), (3, 2), (4, 4), (7, 5))
KEPT = """
import numpy as np
from cmpsp_ros.mpsp.jit import compilations
from cmpsp_ros.mpsp.qp.riccati.kkt import kkt_residual
from cmpsp_ros.mpsp.qp.riccati.program import empty_program

for n, r in ((3, 2), (2, 1)):
    with compilations() as names:
        kkt_residual(empty_program(2, n, r, 1, 1))
    print(len(names))
"""


@allocation_free
def sweep(p):
    """Read and write at the ends of fields, in other records, and at constant places."""
    last, product = p.head[0].horizon, room_for(p.stages[0].L_X)
    n, r = p.stages[0].B.shape
    for k in range(last):
        stage, following = p.stages[k], p.stages[k + 1]
        for i in range(n):
            product[i] = 0.0
            for j in range(n):
                product[i] += stage.A[i, j] * following.dX[j]
        for i in range(n):
            following.origin_X[i] = product[n - 1 - i]
        following.correction_X[n - 1] = stage.B[n - 1, r - 1] + p.stages[1].dU[0]
        p.path[k, 1].U[r - 1] = following.L_UU[r - 1, 0] + p.path[k + 1, 0].merit


def random_program(n, r):
    p, rng = empty_program(4, n, r, 2, 2), np.random.default_rng(n)
    for records in (p.stages, p.terminal, p.path):
        for name in records.dtype.names:
            records[name] = rng.standard_normal(records[name].shape)
    return p


def as_records(p):
    return type(p)(*(each.view(np.recarray) for each in p))


@pytest.mark.parametrize(('n', 'r'), SIZES)
def test_compiled_code_does_what_the_function_does_in_python(n, r, monkeypatch):
    found, wanted = random_program(n, r), random_program(n, r)
    before = found.stages.copy()
    sweep(found)
    monkeypatch.setitem(sweep.py_func.__globals__, 'room_for', np.empty_like)
    sweep.py_func(as_records(wanted))
    for mine, other in zip(found, wanted, strict=True):
        for name in mine.dtype.names:
            np.testing.assert_allclose(mine[name], other[name], rtol=1e-14, err_msg=name)
    assert not np.array_equal(found.stages, before)


def test_another_size_is_translated_no_more(environment):
    @allocation_free
    def largest(p):
        total = 0.0
        for k in range(p.stages.shape[0]):
            total = max(total, p.stages[k].dX[p.stages[k].dX.shape[0] - 1])
        return total

    names = []
    for n, r in SIZES[:2]:
        p = empty_program(2, n, r, 1, 1)
        p.stages['dX'][2] = 4.0
        with compilations() as found:
            assert largest(p) == 4.0
        names.append([re.sub(r'.*\.', '', each) for each in found])
    assert names == [['largest', 'largest'], ['largest']]


def test_functions_that_only_fit_one_size_are_translated_for_each(environment):
    @allocation_free
    def total(p):
        found = 0.0
        for stage in p.stages:
            found += stage.dX[stage.dX.shape[0] - 1]
        return found

    for n, r in SIZES[:2]:
        p = empty_program(2, n, r, 1, 1)
        p.stages['dX'] = 2.0
        assert total(p) == 6.0


@pytest.mark.slow
def test_the_next_process_makes_machine_code_of_no_size_again(run):
    first, second = run(KEPT), run(KEPT)
    assert int(first[0]) > 2
    assert first[1] == '1'
    assert second == ['0', '0']
