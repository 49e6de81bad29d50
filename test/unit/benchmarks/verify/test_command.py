"""`cmpsp bench --verify`: its exit code says whether anything is wrong that nothing explains."""

import json

import pytest
from typer.testing import CliRunner

from benchmarks.verify import run
from benchmarks.verify.programs.families import cases
from benchmarks.verify.run import batches, compare_batch
from cmpsp_ros.cli import app

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


def test_wrong_answers_are_named_and_exit_code_1(monkeypatch, erring, moved):
    wrong = erring(moved(1e-3))
    (batch,) = batches(1)
    compared = compare_batch(batch, wrong)
    monkeypatch.setattr(run, 'verify', lambda *_: compared)
    result = bench('--verify', 1)
    assert result.exit_code == 1
    assert f'{compared[0].origin}: ' in result.output
    assert 'residual: ' in result.output


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
