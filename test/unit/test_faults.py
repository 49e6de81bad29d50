"""Each row of doc/reference/faults.md is held against the code by the test that it names."""

import ast
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_every_test_that_is_named_compares_its_row(faults):
    assert faults
    for row in faults:
        path, _, name = row.test.partition('::')
        assert '/test_' in path
        assert name.startswith('test_')
        tree = ast.parse((ROOT / path).read_text(encoding='utf-8'))
        (test,) = [each for each in tree.body if getattr(each, 'name', '') == name]
        assert 'fault' in {argument.arg for argument in test.args.args}, row.test
        assert row.fallback in {'nominal', 'elastic', 'previous_plan', 'stop', '—'}
        assert row.level in {'OK', 'WARN', 'ERROR'}
