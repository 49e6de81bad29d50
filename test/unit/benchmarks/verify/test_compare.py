"""The comparison: silent about a right back end, and never about a wrong one."""

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.verify.case import contestant
from benchmarks.verify.compare import compare
from benchmarks.verify.references import ReferenceVerdict
from benchmarks.verify.run import cases, verify_case
from cmpsp_ros.mpsp.qp import Penalties, QPStatus, Row


def checks(comparison):
    return {finding.check for finding in comparison.findings if not finding.explanation}


def relaxed(subproblem, terminal=10.0, path=1.0):
    shape = subproblem.linearisation.g.shape
    return Penalties(np.full(1, terminal), np.full(shape, path))


def hard_cases(family, seed):
    return [each for each in cases(family, seed) if each.program.penalties is None]


@pytest.mark.parametrize('by', [1e-6, -1e-4, 0.1])
@pytest.mark.parametrize('family', ['loop', 'general', 'degenerate'])
def test_a_point_slightly_off_is_found(family, by, erring, moved):
    wrong = erring(moved(by))
    solved = 0
    for each in cases(family, 0):
        comparison = compare(each, wrong)
        if comparison.status is QPStatus.SOLVED:
            solved += 1
            assert comparison.is_mismatch, comparison
    assert solved


def test_each_part_that_is_wrong_is_found(scalar, case_of, erring):
    case = case_of(scalar(limit=1.5), relaxed(scalar()))
    assert compare(case, erring()).findings == ()
    for part in ('terminal', 'path', 'bounds'):

        def change(answer, part=part):
            return replace(answer, **{part: getattr(answer, part) + 1e-3})

        assert 'residual' in checks(compare(case, erring(change))), part


def test_a_solution_claimed_where_there_is_none_is_found(scalar, case_of, erring):
    def claim(answer):
        return replace(answer, status=QPStatus.SOLVED)

    comparison = compare(case_of(scalar(limit=0.5)), erring(claim))
    assert comparison.verdict is ReferenceVerdict.INFEASIBLE
    assert checks(comparison) >= {'status', 'residual'}
    for each in hard_cases('infeasible', 0):
        comparison = compare(each, erring(claim))
        if comparison.verdict is ReferenceVerdict.INFEASIBLE:
            assert 'status' in checks(comparison)


@pytest.mark.parametrize(
    ('limit', 'is_relaxed', 'status'),
    [
        *((5.0, False, each) for each in (QPStatus.INFEASIBLE, QPStatus.FAILED)),
        *((5.0, True, each) for each in (QPStatus.INFEASIBLE, QPStatus.FAILED)),
        # Without a solution, and on the border where the references agree.
        *((each, False, QPStatus.FAILED) for each in (0.5, 2.0)),
    ],
)
def test_a_wrong_status_is_found(scalar, case_of, erring, limit, is_relaxed, status):
    def say(answer):
        return replace(answer, status=status)

    case = case_of(scalar(limit=limit), relaxed(scalar()) if is_relaxed else None)
    assert checks(compare(case, erring(say))) == {'status'}


@pytest.mark.parametrize('status', [QPStatus.SOLVED, QPStatus.INFEASIBLE])
def test_either_status_is_explained_on_the_border(scalar, case_of, erring, status):
    def say(answer):
        point = np.array([[2.0], [0.0]])
        return replace(answer, status=status, dU=point, terminal=np.array([-2.0]))

    comparison = compare(case_of(scalar(limit=2.0 - 1e-9)), erring(say))
    assert 'status' not in checks(comparison)
    comparison = compare(case_of(scalar(limit=2.0 + 1e-9)), erring(say))
    assert 'status' not in checks(comparison)


def test_warm_starts_that_change_the_answer_are_found(scalar, case_of, erring, moved):
    case = case_of(scalar(), relaxed(scalar()))
    right = compare(case, erring(warmed=lambda answer: answer))
    assert right.findings == ()
    off = compare(case, erring(warmed=moved(1e-4)))
    assert checks(off) == {'warm start'}
    assert 'residual' in off.findings[0].found

    def deny(answer):
        return replace(answer, status=QPStatus.INFEASIBLE)

    denied = compare(case, erring(warmed=deny))
    assert [finding.found for finding in denied.findings] == [
        'INFEASIBLE with a warm start, SOLVED cold'
    ]
    assert denied.is_mismatch


# Not the families of many sizes: it is compiled for each.
@pytest.mark.parametrize('family', ['loop', 'crowded', 'flat'])
def test_active_set_is_right_cold_and_warm(family):
    chosen = contestant('riccati_active_set')
    assert chosen.warm is not None
    for each in cases(family, 2):
        assert not compare(each, chosen).is_mismatch


@pytest.mark.parametrize(
    'name',
    [
        'infeasible/1/7',
        'infeasible/15/5',
        'infeasible/86/1',
        'infeasible/92/8',
        'infeasible/158/6',
        'infeasible/185/3',
        'degenerate/236/7',
        'loop/798/8',
    ],
)
def test_what_rounding_makes_look_like_a_contradiction_is_looked_at_again(name):
    assert verify_case(name, 'riccati_active_set').findings == ()


def test_rows_named_without_a_conflict_are_found(scalar, case_of, erring):
    def name(*rows):
        return lambda answer: replace(answer, conflict=rows)

    case = case_of(scalar(limit=0.5))
    goal, limit, bound = Row('terminal', 1, 0), Row('path', 1, 0), Row('bound', 0, 0)
    assert checks(compare(case, erring(name(goal, limit)))) == set()
    assert checks(compare(case, erring(name(goal, bound)))) == {'conflict'}
    assert checks(compare(case, erring(name(limit)))) == {'conflict'}
    case = case_of(scalar(upper=1.0))
    assert checks(compare(case, erring(name(goal, bound)))) == set()


def test_a_back_end_that_raises_is_named_with_its_case(scalar, case_of, erring):
    def crash(answer):
        raise ZeroDivisionError('by zero')

    with pytest.raises(ZeroDivisionError) as caught:
        compare(case_of(scalar()), erring(crash))
    assert caught.value.__notes__ == ['erring at test/0/0: a test']
