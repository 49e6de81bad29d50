"""What holds for all tests."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import pytest
from hypothesis import settings

ROOT = Path(__file__).parents[1]
LEVELS = ('OK', 'WARN', 'ERROR')
# What may follow a sentence about a plan, where there were several.
CHOICE = r'( (It is|Changed over to) the best of \d+ plans(, [^.]+)?\.)?'

# No test by examples is about time, and the first example may compile. The examples are the same
# every time; others come with --hypothesis-profile=exploring.
settings.register_profile('exploring', deadline=None)
settings.register_profile('repeatable', deadline=None, derandomize=True)
settings.load_profile('repeatable')


@dataclass(frozen=True)
class Fault:
    """A row of doc/faults.md.

    Attributes:
        rung: What is commanded; a dash where only diagnostics tell.
        level: As in diagnostics, in words.
        says: The sentence; each `…` stands for something or other, and which of several plans it is
            may follow.
        test: Path and name of the test that holds the row against what really happens.
    """

    rung: str
    level: str
    says: str
    test: str

    def fits(self, rung, level, sentence):
        pattern = '.+'.join(re.escape(part) for part in self.says.split('…')) + CHOICE
        same = (rung, LEVELS[level]) == (self.rung, self.level)
        return same and re.fullmatch(pattern, sentence) is not None


class Faults:
    """The rows that name one test."""

    def __init__(self, rows):
        self.rows, self.compared = rows, set()

    def assert_said(self, rung, level, sentence):
        """What was said must fit a row: rung, level (0 to 2) and sentence."""
        fitting = {row for row in self.rows if row.fits(rung, level, sentence)}
        assert fitting, f'{rung}, {LEVELS[level]}: {sentence!r} fits none of {self.rows}'
        self.compared |= fitting


def _rows():
    for line in (ROOT / 'doc' / 'faults.md').read_text(encoding='utf-8').splitlines():
        cells = [cell.strip() for cell in line.strip('|').split('|')]
        if line.startswith('|') and cells[-1].startswith('`test/'):
            _, _, rung, level, says, test = cells
            yield Fault(rung, level, says, test.strip('`'))


@pytest.fixture(scope='session')
def faults():
    """All rows of doc/faults.md."""
    return list(_rows())


@pytest.fixture
def fault(request, faults):
    """The rows of doc/faults.md that name this test; it must compare all of them."""
    name = f'{request.path.relative_to(ROOT).as_posix()}::{request.function.__name__}'
    mine = Faults([row for row in faults if row.test == name])
    yield mine
    assert mine.compared == set(mine.rows) != set()
