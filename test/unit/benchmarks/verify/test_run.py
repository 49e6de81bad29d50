"""Runs over all families, on one process and two, and what they report."""

import json
from collections import Counter
from itertools import islice

import pytest

from benchmarks.errors import BenchError
from benchmarks.verify.programs.families import SHARES
from benchmarks.verify.report import lines, mismatches, to_json
from benchmarks.verify.run import Batch, batches, compare_batch, verify, verify_case
from cmpsp_ros.mpsp import ProblemError
from cmpsp_ros.mpsp.qp import QPStatus


@pytest.mark.parametrize('count', [1, 7, 40, 1000, 20000])
def test_batches_share_the_count_out(count):
    todo = batches(count)
    assert sum(batch.programs for batch in todo) == count
    assert max(batch.programs for batch in todo) <= 10
    assert len({batch[:2] for batch in todo}) == len(todo)
    if count >= 1000:
        of_family = Counter()
        for batch in todo:
            of_family[batch.family] += batch.programs
        for family, share in SHARES.items():
            assert of_family[family] == pytest.approx(share * count, abs=1)
        assert {batch.family for batch in todo[: len(todo) // 10]} == set(SHARES)


@pytest.fixture(scope='module')
def compared():
    return verify(30, 'daqp')


def test_progress_counts_every_program():
    told = []
    assert len(verify(12, 'daqp', progress=told.append)) == sum(told) == 12


def test_workers_come_to_the_same(compared):
    assert verify(30, 'daqp', workers=2) == compared


def test_one_case_alone_comes_to_the_same(compared):
    for each in (compared[3], compared[-1]):
        assert verify_case(str(each.origin), 'daqp') == each


def test_lines_add_up(compared):
    *families, together = lines(compared)
    assert together.family == 'all'
    assert together.programs == 30
    for name in ('programs', 'solved', 'infeasible', 'agree', 'explained', 'mismatches'):
        assert sum(getattr(line, name) for line in families) == getattr(together, name)
    for line in [*families, together]:
        assert line.agree + line.explained + line.mismatches == line.programs
    assert together.mismatches == len(mismatches(compared))
    solved = [each for each in compared if each.status is QPStatus.SOLVED]
    assert together.solved == len(solved)
    assert together.residual == max(each.accuracy.residual for each in solved)


def test_findings_are_written_with_the_names_of_their_cases(erring, moved):
    wrong = erring(moved(1e-3))
    results = compare_batch(Batch('general', 0, 3), wrong)
    content = json.loads(to_json(results, 'erring'))
    assert content['qp'] == 'erring'
    assert content['families'][-1]['mismatches'] == len(mismatches(results)) > 0
    named = {finding['case'] for finding in content['findings']}
    assert named == {str(each.origin) for each in results if each.findings}
    assert all(finding['explanation'] == '' for finding in islice(content['findings'], 1))


def test_what_does_not_exist_is_refused():
    with pytest.raises(ProblemError, match="qp: found 'newton'"):
        verify(1, 'newton')
    with pytest.raises(BenchError, match='wanted FAMILY/SEED/NUMBER'):
        verify_case('loop', 'daqp')
