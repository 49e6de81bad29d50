"""Properties of each family of programs, without which the comparison would be idle."""

from itertools import islice

import numpy as np
import pytest

from benchmarks.verify.case import Origin, Program
from benchmarks.verify.programs import degenerate
from benchmarks.verify.programs.general import random_program, row_values
from benchmarks.verify.programs.loop import subproblems
from benchmarks.verify.programs.scenario import draw_horizon, tangent
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


def test_horizons_are_mostly_short_and_reach_200():
    rng = np.random.default_rng(0)
    drawn = np.array([draw_horizon(rng) for _ in range(4000)])
    assert drawn.min() == 1
    assert 195 <= drawn.max() <= 200
    assert 0.5 < (drawn <= 30).mean() < 0.6
    assert 0.07 < (drawn > 60).mean() < 0.13


def test_loops_visit_later_steps_second_iterations_and_both_trust_regions():
    about, trusted = [], set()
    for seed in range(12):
        for each in cases('loop', seed):
            about.append(each.about)
            trusted.add(bool(np.isfinite(each.program.subproblem.trust_radius).any()))
    assert trusted == {True, False}
    assert any('iteration 2' in text for text in about)
    assert any(', step 0,' not in text for text in about)
    assert any('relaxed at 1000' in text for text in about)
    assert any('relaxed at 10,' in f'{text},' for text in about)


def test_random_programs_have_cross_terms_growth_and_rows_of_both_kinds():
    rng = np.random.default_rng(1)
    linearisations = [random_program(rng).subproblem.linearisation for _ in range(60)]
    assert any(lin.L_UX.any() for lin in linearisations)
    assert any(np.abs(np.linalg.eigvals(lin.A)).max() > 1.1 for lin in linearisations)
    mixed = [
        (lin.g_X.any(axis=2) & lin.g_U.any(axis=2) & np.isfinite(lin.g)).any()
        for lin in linearisations
    ]
    assert any(mixed)
    assert {len(lin.output_error) for lin in linearisations} == {0, 1, 2, 3}
    for lin in linearisations:
        n = lin.A.shape[1]
        whole = np.block([[lin.L_XX, lin.L_UX.transpose(0, 2, 1)], [lin.L_UX, lin.L_UU]])
        assert np.linalg.eigvalsh(whole).min() > -1e-9 * np.abs(whole).max()
        assert np.linalg.eigvalsh(whole[:, n:, n:]).min() > 0.0


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


def test_obstacles_touch_an_edge():
    rng = np.random.default_rng(4)
    for _ in range(20):
        settings = tangent(rng).settings
        first, road = settings.obstacles[0], settings.road
        away = np.hypot(*first.center)
        gaps = [
            abs(abs(away - edge) - first.radius) for edge in (road.inner_radius, road.outer_radius)
        ]
        assert min(gaps) < 1e-12
    assert next(subproblems(tangent, rng))[0].startswith('tangent')


def test_crowded_programs_have_many_active_rows():
    counts = []
    for each in islice((c for seed in range(4) for c in cases('crowded', seed)), 40):
        answer = clarabel_solve(each.program)
        if answer.status is not QPStatus.SOLVED:
            continue
        parts = answer.path, answer.trust, answer.bounds
        counts.append(sum(int((np.abs(part) > 1e-3).sum()) for part in parts))
    assert np.median(counts) > 10
    assert max(counts) > 60
