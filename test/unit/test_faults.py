"""Each row of doc/reference/faults.md is held against the code by the test that it names."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def test_every_row_names_a_test_that_is_collected(faults):
    named = {row.test for row in faults}
    assert named
    files = sorted({name.partition('::')[0] for name in named})
    command = [sys.executable, '-m', 'pytest', '--collect-only', '-q', '-p', 'no:cacheprovider']
    said = subprocess.run([*command, *files], cwd=ROOT, capture_output=True, text=True, check=True)
    collected = {line.partition('[')[0] for line in said.stdout.splitlines()}
    assert named <= collected


def test_every_test_that_is_named_compares_its_row(faults):
    for row in faults:
        path, _, name = row.test.partition('::')
        tree = ast.parse((ROOT / path).read_text(encoding='utf-8'))
        (test,) = [each for each in tree.body if getattr(each, 'name', '') == name]
        assert 'fault' in {argument.arg for argument in test.args.args}, row.test
        assert row.fallback in {'nominal', 'elastic', 'previous_plan', 'stop', '—'}
        assert row.level in {'OK', 'WARN', 'ERROR'}


@pytest.mark.parametrize(
    ('fallback', 'level', 'sentence'),
    [
        ('elastic', 1, 'The final time has passed, 3 m from the goal.'),
        ('stop', 2, 'The final time has passed, 3 m from the goal.'),
        ('stop', 1, 'The final time has passed.'),
        ('stop', 1, 'So: The final time has passed, 3 m from the goal.'),
    ],
)
def test_what_is_not_as_in_the_row_is_noticed(faults, fallback, level, sentence):
    row = next(each for each in faults if 'has passed, ' in each.says)
    assert row.fits('stop', 1, 'The final time has passed, 3 m from the goal.')
    assert not row.fits(fallback, level, sentence)
