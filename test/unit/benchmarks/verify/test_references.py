"""The references, where the answer is known or where two must agree."""

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.verify.case import Program
from benchmarks.verify.programs.general import random_program
from benchmarks.verify.references import (
    ReferenceVerdict,
    accuracy,
    clarabel_solve,
    cost,
    duality_gap,
    last_bit,
    least_violation,
    nearly_feasible,
    nearly_infeasible,
    references,
    verdict,
)
from cmpsp_ros.mpsp.qp import Penalties, QPStatus, Subproblem
from cmpsp_ros.mpsp.qp.dense import solve_by_daqp


def prices(terminal, path):
    return Penalties(np.full(1, terminal), np.full((2, 1), path))


def daqp(program):
    return solve_by_daqp(program.subproblem, program.penalties, 1e-9)


@pytest.mark.parametrize('solve', [clarabel_solve, daqp])
def test_hard_program_by_hand(scalar, solve):
    answer = solve(Program(scalar()))
    assert answer.status is QPStatus.SOLVED
    np.testing.assert_allclose(answer.dU, [[2.0], [0.0]], atol=1e-8)
    np.testing.assert_allclose(answer.terminal, [-2.0], atol=1e-8)
    np.testing.assert_allclose(answer.path, 0.0, atol=1e-8)


def test_bound_and_trust_multipliers_by_hand(scalar):
    # Relaxed, the goal pulls with 7: up to the bound at 1, which takes 6 of it.
    answer = clarabel_solve(Program(scalar(upper=1.0), prices(7.0, 1.0)))
    np.testing.assert_allclose(answer.dU[0], 1.0, atol=1e-8)
    np.testing.assert_allclose(answer.terminal, [-7.0], atol=1e-7)
    np.testing.assert_allclose(answer.bounds[0], 6.0, atol=1e-7)


@pytest.mark.parametrize(
    ('limit', 'terminal', 'path', 'wanted'),
    [
        (1.0, 10.0, 1.0, 2.0),  # the goal is dearer than the limit
        (1.0, 10.0, 20.0, 1.0),  # and the other way round
        (5.0, 0.5, 1.0, 0.5),  # a goal too cheap to be reached
    ],
)
def test_relaxed_program_by_hand(scalar, limit, terminal, path, wanted):
    program = Program(scalar(limit), prices(terminal, path))
    answer = clarabel_solve(program)
    np.testing.assert_allclose(answer.dU[0], wanted, atol=1e-8)
    measured = accuracy(program, answer)
    assert measured.residual < 1e-9
    assert abs(measured.gap) < 1e-9
    by_hand = 0.5 * wanted**2 + terminal * abs(wanted - 2.0) + path * max(wanted - limit, 0.0)
    assert cost(program, answer.dU).value == pytest.approx(by_hand, abs=1e-7)


def test_contradiction_is_named_and_measured(scalar):
    program = Program(scalar(limit=0.5))
    assert clarabel_solve(program).status is QPStatus.INFEASIBLE
    assert daqp(program).status is QPStatus.INFEASIBLE
    # x_1 = 2 and x_1 <= 0.5.
    assert least_violation(program) == pytest.approx(1.5, abs=1e-8)
    assert verdict(references(program)) is ReferenceVerdict.INFEASIBLE
    assert not nearly_feasible(program)


@pytest.mark.parametrize('by', [-1e-9, 0.0, 1e-9])
def test_border_of_feasibility(scalar, by):
    program = Program(scalar(limit=2.0 + by))
    assert nearly_feasible(program)
    assert nearly_infeasible(program)
    roomy = Program(scalar(limit=2.1))
    assert nearly_feasible(roomy)
    assert not nearly_infeasible(roomy)


def test_relaxed_programs_are_infeasible_by_bounds_and_trust_region_alone(scalar):
    relaxed = Program(scalar(limit=0.5), prices(1.0, 1.0))
    assert least_violation(relaxed) == pytest.approx(0.0, abs=1e-8)
    assert not nearly_infeasible(relaxed)


def test_gap_is_the_distance_from_the_optimum(scalar):
    program = Program(scalar())
    answer = clarabel_solve(program)
    # Off by 0.3 in the control that nothing but the cost holds: 0.3^2 / 2 too dear.
    answer.dU[1] += 0.3
    size = cost(program, answer.dU).size
    assert duality_gap(program, answer) * size == pytest.approx(0.045, abs=1e-7)
    # Multipliers off by 0.1: the bound they prove is lower by 0.1^2 / 2.
    answer.dU[1] = 0.0
    answer.terminal[0] += 0.1
    size = cost(program, answer.dU).size
    assert duality_gap(program, answer) * size == pytest.approx(0.005, abs=1e-7)


def test_gap_believes_no_multiplier_above_its_price(scalar):
    program = Program(scalar(), prices(0.5, 1.0))
    answer = clarabel_solve(program)
    assert abs(duality_gap(program, answer)) < 1e-9
    answer.terminal[0] = -1.0
    assert duality_gap(program, answer) == pytest.approx(0.0, abs=1e-9)
    answer.terminal[0] = 1.0
    assert duality_gap(program, answer) > 0.1


@pytest.mark.parametrize('seed', range(12))
def test_references_agree_on_random_programs(seed):
    rng = np.random.default_rng(seed)
    known = random_program(rng)
    while known.dU.size > 122:
        known = random_program(rng)
    program = Program(known.subproblem)
    first, second = references(program)
    assert {first.name, second.name} == {'clarabel', 'daqp'}
    for each in (first, second):
        assert each.accuracy.residual < 1e-7
        assert abs(each.accuracy.gap) < 1e-8
    theirs = cost(program, second.solution.dU)
    assert abs(cost(program, first.solution.dU).value - theirs.value) < 1e-8 * theirs.size
    assert verdict([first, second]) is ReferenceVerdict.SOLVED
    # Known controls are feasible, and no better.
    size = cost(program, known.dU).size
    best = cost(program, first.solution.dU).value
    assert best <= cost(program, known.dU).value + 1e-9 * size


def test_rounding_shows_in_the_residual_of_unstable_programs_only(scalar):
    program = Program(scalar())
    assert last_bit(program, clarabel_solve(program)) < 1e-14
    # What the cost pulls at every control for, twelve steps that multiply by 10 carry along.
    N = 12
    lin = scalar().linearisation
    grown = replace(
        lin,
        A=np.full((N, 1, 1), 10.0),
        B=np.ones((N, 1, 1)),
        **{
            name: np.repeat(getattr(lin, name)[-1:], N + 1, axis=0)
            for name in ('L_X', 'L_XX', 'L_UX', 'L_UU', 'g_X', 'g_U')
        },
        L_U=np.ones((N + 1, 1)),
        g=np.full((N + 1, 1), -np.inf),
    )
    free = np.full((N + 1, 1), np.inf)
    unstable = Program(Subproblem(grown, -free, free, np.full(1, np.inf)))
    assert last_bit(unstable, daqp(unstable)) > 1e-8


def test_answers_that_are_none_are_infinitely_bad(scalar):
    program = Program(scalar(limit=0.5))
    measured = accuracy(program, daqp(program))
    assert measured == (math.inf, math.inf)
    answer = clarabel_solve(Program(scalar()))
    answer.dU[0] = np.nan
    assert accuracy(program, answer) == (math.inf, math.inf)
