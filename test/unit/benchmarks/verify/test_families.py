"""Properties of each family of programs, without which the comparison would be idle."""

import numpy as np
import pytest

from benchmarks.verify.case import Origin, Program
from benchmarks.verify.programs import degenerate
from benchmarks.verify.programs.general import random_program, row_values
from benchmarks.verify.references import clarabel_solve, least_violation
from benchmarks.verify.run import FAMILIES, PROGRAMS_PER_SEED, case, cases
from cmpsp_ros.mpsp import Dimensions
from cmpsp_ros.mpsp.qp import QPStatus


def sizes(subproblem):
    lin = subproblem.linearisation
    N, n, r = lin.B.shape
    return Dimensions(N, n, r, len(lin.output_error), lin.g.shape[1])


@pytest.mark.parametrize('family', FAMILIES)
def test_programs_are_sound_and_of_both_kinds(family):
    relaxed = []
    for each in [*cases(family, 0), *cases(family, 1)]:
        program, before = each.program, each.before
        size = sizes(program.subproblem)
        program.subproblem.linearisation.check(size)
        before.subproblem.linearisation.check(size)
        assert (program.subproblem.lower <= program.subproblem.upper).all()
        relaxed.append(program.penalties is not None)
    assert len(relaxed) == 2 * PROGRAMS_PER_SEED
    assert 0 < sum(relaxed) < len(relaxed)


def arrays(subproblem):
    return vars(subproblem.linearisation) | {
        name: getattr(subproblem, name) for name in ('lower', 'upper', 'trust_radius')
    }


@pytest.mark.parametrize('family', FAMILIES)
def test_a_program_is_made_again_from_its_name(family):
    first = list(cases(family, 3))
    again = case(Origin.parse(str(first[7].origin)))
    assert again.about == first[7].about
    for part in ('program', 'before'):
        one, other = (getattr(each, part).subproblem for each in (first[7], again))
        np.testing.assert_equal(arrays(one), arrays(other))


@pytest.mark.parametrize('change', degenerate.CHANGES, ids=lambda change: change.__name__)
def test_degenerate_programs_keep_a_feasible_point(change):
    rng = np.random.default_rng(2)
    changed_something = False
    for _ in range(6):
        known = random_program(rng)
        subproblem = change(known, rng)
        miss, path = row_values(subproblem, known.dU)
        reach = 1.0 + np.abs(row_values(known.subproblem, known.dU)[1][1:]).max(
            initial=0.0, where=np.isfinite(known.subproblem.linearisation.g[1:])
        )
        scale = 1e3 * reach
        assert np.abs(miss).max(initial=0.0) < 1e-9 * scale
        assert path.max(initial=-np.inf) < 1e-9 * scale
        assert (subproblem.lower <= known.dU + 1e-12).all()
        assert (known.dU <= subproblem.upper + 1e-12).all()
        dX = np.abs(subproblem.propagate(known.dU))
        assert (dX <= subproblem.trust_radius * (1 + 1e-12)).all()
        before, after = arrays(known.subproblem), arrays(subproblem)
        changed_something |= any(not np.array_equal(before[name], after[name]) for name in after)
    assert changed_something


@pytest.mark.parametrize('change', degenerate.CONTRADICTIONS, ids=lambda change: change.__name__)
def test_contradicting_programs_have_no_solution(change):
    rng = np.random.default_rng(3)
    seen = 0
    while seen < 5:
        known = random_program(rng)
        # Nothing pulls at controls that are held where no terminal row wants anything.
        if not len(known.subproblem.linearisation.output_error):
            continue
        seen += 1
        program = Program(change(known, rng))
        assert clarabel_solve(program).status is QPStatus.INFEASIBLE
        assert least_violation(program) > 1e-7
