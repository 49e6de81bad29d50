"""Fixtures for all tests."""

import ast
import re
import signal
import sys
import zlib
from contextlib import contextmanager
from dataclasses import dataclass
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path

import pytest
from hypothesis import settings

ROOT = Path(__file__).parents[1]
INTEGRATION = ROOT / 'test' / 'integration'
LEVELS = ('OK', 'WARN', 'ERROR')
# What may follow a sentence about a plan, where there were several.
CHOICE = (
    r'( (It is|Changed over to) the best of \d+ plans(, [^.]+)?\.)?'
    r'( The work of this step was used up\.)?'
)

# No test by examples is about time, and the first example may compile. The examples are the same
# every time; others come with --hypothesis-profile=exploring.
settings.register_profile('exploring', deadline=None)
settings.register_profile('repeatable', deadline=None, derandomize=True)
settings.load_profile('repeatable')

# Longest time of a fast test, and of one that can be in a part [s].
LONGEST = 120


def pytest_addoption(parser):
    parser.addoption(
        '--part',
        type=_part,
        metavar='K/N',
        help='only part K of N (from 1) of what is selected; not what takes minutes by itself',
    )


def _part(text):
    number, count = map(int, text.split('/'))
    if not 1 <= number <= count:
        raise ValueError(text)
    return number, count


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """Mark tests by rule (doc/reference/testing.md), and leave out all but one part."""
    for item in items:
        if _is_integration(item):
            item.add_marker(pytest.mark.integration)
        if _is_slow(item):
            item.add_marker(pytest.mark.slow)
        elif not any(item.iter_markers('slow')) and not any(item.iter_markers('timeout')):
            item.add_marker(pytest.mark.timeout(LONGEST))
        if any(item.iter_markers('ros')) and find_spec('rclpy') is None:
            item.add_marker(pytest.mark.skip('there is no ROS'))
    part = config.getoption('part')
    if part is not None:
        others = [item for item in items if not _is_in(item, *part)]
        items[:] = [item for item in items if _is_in(item, *part)]
        config.hook.pytest_deselected(items=others)


def _is_integration(item):
    return item.path.is_relative_to(INTEGRATION)


def _is_slow(item):
    is_smoke = item.get_closest_marker('smoke') is not None
    return (_is_integration(item) and not is_smoke) or _takes_minutes(item)


def _takes_minutes(item):
    timeout = item.get_closest_marker('timeout')
    return timeout is not None and timeout.args[0] > LONGEST


def _is_in(item, number, count):
    if _takes_minutes(item):
        return False
    # What tests of one group share is made once.
    group = item.get_closest_marker('xdist_group')
    name = group.args[0] if group is not None else item.nodeid
    return zlib.crc32(name.encode()) % count == number - 1


@pytest.fixture(scope='session')
def program():
    """A program that stands beside tests, as a module; several of one name are told apart."""

    def load(path):
        name = '.'.join(path.relative_to(ROOT).with_suffix('').parts)
        spec = spec_from_file_location(name, path)
        module = sys.modules[name] = module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    return load


@pytest.fixture
def launch_file():
    """Decisions of a launch file, by name: `launch_file(path)['nodes'](given)`.

    Its imports are left out, for `launch` is not there; a node is the mapping of its arguments.
    """

    def not_there(name):
        raise LookupError(name)

    def load(path):
        tree = ast.parse(path.read_text(encoding='utf-8'))
        plain = (ast.Import, ast.Assign, ast.FunctionDef)
        tree.body = [each for each in tree.body if isinstance(each, plain)]
        names = {
            '__file__': str(path), 'Path': Path, 'Node': dict, 'Shutdown': dict,
            'LaunchDescription': None, 'get_package_prefix': not_there,
            'PackageNotFoundError': LookupError,
        }  # fmt: skip
        exec(compile(tree, path, 'exec', dont_inherit=True), names)
        return names

    return load


@pytest.fixture(scope='session')
def interruptible():
    """Processes started in this context answer SIGINT, even if these tests are to ignore it.

    A script has its background jobs ignore it (`make test &`), and they have all that they start.
    """

    @contextmanager
    def heard():
        before = signal.getsignal(signal.SIGINT)
        if before is signal.SIG_IGN:
            signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            yield
        finally:
            if before is signal.SIG_IGN:
                signal.signal(signal.SIGINT, before)

    return heard


@dataclass(frozen=True)
class Fault:
    """A row of doc/reference/faults.md.

    Attributes:
        fallback: What is commanded; a dash where only diagnostics tell.
        level: As in diagnostics, in words.
        says: The sentence; each `…` stands for something or other, and which of several plans it is
            may follow.
        test: Path and name of the test that holds the row against what really happens.
    """

    fallback: str
    level: str
    says: str
    test: str

    def fits(self, fallback, level, sentence):
        pattern = '.+'.join(re.escape(part) for part in self.says.split('…')) + CHOICE
        same = (fallback, LEVELS[level]) == (self.fallback, self.level)
        return same and re.fullmatch(pattern, sentence) is not None


class Faults:
    """The rows that name one test."""

    def __init__(self, rows):
        self.rows, self.compared = rows, set()

    def assert_said(self, fallback, level, sentence):
        """Check that a decision fits a row: fallback, level (0 to 2) and sentence."""
        fitting = {row for row in self.rows if row.fits(fallback, level, sentence)}
        assert fitting, f'{fallback}, {LEVELS[level]}: {sentence!r} fits none of {self.rows}'
        self.compared |= fitting

    def assert_decided(self, decision):
        """Check that a decision, as its message has it, fits a row."""
        self.assert_said(decision['fallback_level'], decision['level'][0], decision['reason'])

    def assert_told(self, health):
        """Check that diagnostics fit a row."""
        self.assert_said('—', health['level'][0], health['said'])


def _rows():
    for line in (ROOT / 'doc' / 'reference' / 'faults.md').read_text(encoding='utf-8').splitlines():
        cells = [cell.strip() for cell in line.strip('|').split('|')]
        if line.startswith('|') and cells[-1].startswith('`test/'):
            _, _, fallback, level, says, test = cells
            yield Fault(fallback, level, says, test.strip('`'))


@pytest.fixture(scope='session')
def faults():
    """All rows of doc/reference/faults.md."""
    return list(_rows())


@pytest.fixture
def fault(request, faults):
    """The rows of doc/reference/faults.md that name this test; it must compare all of them."""
    name = f'{request.path.relative_to(ROOT).as_posix()}::{request.function.__name__}'
    mine = Faults([row for row in faults if row.test == name])
    yield mine
    assert mine.compared == set(mine.rows) != set()
