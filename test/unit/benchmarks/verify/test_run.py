"""Runs over all families, on one process and two, their report, and the command."""

import json
from itertools import islice

import pytest
from typer.testing import CliRunner

from benchmarks.verify.report import mismatches, to_json
from benchmarks.verify.run import Batch, cases, compare_batch, verify, verify_case
from cmpsp_ros.cli import app


@pytest.fixture(scope='module')
def compared():
    return verify(12, 'daqp')


def test_workers_come_to_the_same(compared):
    assert verify(12, 'daqp', workers=2) == compared


def test_one_case_alone_comes_to_the_same(compared):
    for each in (compared[3], compared[-1]):
        assert verify_case(str(each.origin), 'daqp') == each


def test_findings_are_written_with_the_names_of_their_cases(erring, moved):
    wrong = erring(moved(1e-3))
    results = compare_batch(Batch('general', 0, 3), wrong)
    content = json.loads(to_json(results, 'erring'))
    assert content['qp'] == 'erring'
    assert content['families'][-1]['mismatches'] == len(mismatches(results)) > 0
    named = {finding['case'] for finding in content['findings']}
    assert named == {str(each.origin) for each in results if each.findings}
    assert all(finding['explanation'] == '' for finding in islice(content['findings'], 1))


PLAIN = {'NO_COLOR': '1', 'COLUMNS': '200', 'TERM': 'dumb'}


def bench(*arguments):
    return CliRunner().invoke(app, ['bench', *map(str, arguments)], env=PLAIN)


def test_right_answers_give_a_table_a_file_and_exit_code_0(tmp_path):
    result = bench('--verify', 1, '--qp', 'daqp', '--output', tmp_path / 'findings.json')
    assert result.exit_code == 0, result.output
    assert 'daqp against Clarabel and daqp' in result.output
    content = json.loads((tmp_path / 'findings.json').read_text())
    assert content['families'][-1]['programs'] == content['families'][-1]['agree'] == 1
    assert content['findings'] == []


def test_wrong_answers_are_named_and_exit_code_1():
    # Hildreth's procedure converges on at most one of them; on which, depends on the processor.
    result = bench('--verify', 2, '--qp', 'hildreth')
    assert result.exit_code == 1
    programs = [next(cases(family, 0)).origin for family in ('loop', 'crowded')]
    assert any(f'{each}: ' in result.output for each in programs)
    assert 'status: ' in result.output


def test_one_case_is_described():
    name = next(cases('loop', 0)).origin
    result = bench('--verify-case', name, '--qp', 'daqp')
    assert result.exit_code == 0, result.output
    assert result.output.startswith(f'{name}: ')
    assert 'iterations' in result.output


@pytest.mark.parametrize(
    ('arguments', 'wanted'),
    [
        (('--verify-case', 'loop/1'), "case: found 'loop/1', wanted FAMILY/SEED/NUMBER"),
        (('--verify-case', 'lop/1/1'), "family: found 'lop', wanted one of loop"),
        (('--verify-case', 'loop/1/10'), 'found number 10, wanted below 10'),
        (('--verify', 1, '--qp', 'newton'), "qp: found 'newton', wanted one of"),
        (('--verify', 1, '--output', '.'), '.: found something there, wanted a new file'),
        (('--verify', 1, '--output', 'no/a.json'), 'no is no folder that can be written to'),
    ],
)
def test_bad_input_gives_one_line(arguments, wanted):
    result = bench(*arguments)
    assert result.exit_code == 1
    assert wanted in result.output
    assert 'Traceback' not in result.output
