"""Tables of the documentation: every sentence of a stop, every exit code, each fault's test."""

import ast
import inspect
import re
import sys
from pathlib import Path

import pytest

from cmpsp_ros.cli import app
from cmpsp_ros.mpsp.qp import QPStatus

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / 'doc' / 'user' / 'stops.md').read_text(encoding='utf-8')

# Descriptions of settings and warnings before a run are on other pages; these answer no odometry.
ELSEWHERE = {'feasibility.py', 'solver_settings.py'}
ANSWERS = {'Time 0 is the next odometry.', '… The node goes on without.', 'A rehearsal.'}

SENTENCE = re.compile(r'[A-Z… ].* [a-z].*([.?]|: …)')


def said(path):
    """Sentences in a module, `…` for what varies; docstrings are none."""
    tree = ast.parse(path.read_text(encoding='utf-8'))
    apart = {id(each.value) for each in ast.walk(tree) if isinstance(each, ast.Expr)}
    for each in ast.walk(tree):
        if isinstance(each, ast.JoinedStr):
            apart |= {id(part) for part in each.values}
    for each in ast.walk(tree):
        if id(each) in apart:
            continue
        text = ''
        if isinstance(each, ast.JoinedStr):
            parts = (part.value if isinstance(part, ast.Constant) else '…' for part in each.values)
            text = ''.join(parts)
        elif isinstance(each, ast.Constant) and isinstance(each.value, str):
            text = each.value.replace('{}', '…')
        if SENTENCE.fullmatch(text) and text not in ANSWERS:
            yield re.sub(r': … ?…$', ': …', re.sub('…: …$', '…', text)).strip()


SOURCES = [
    *(each for each in (ROOT / 'cmpsp_ros/guidance').rglob('*.py') if each.name not in ELSEWHERE),
    *(ROOT / 'cmpsp_ros/nodes/guidance').rglob('*.py'),
    ROOT / 'cmpsp_ros/sensing/surroundings.py',
    ROOT / 'cmpsp_ros/nodes/common/health.py',
    ROOT / 'cmpsp_ros/robots/robot.py',
]
# Of the checks before a run one is an answer, and a closed road is: most are warnings.
PRECHECK = ROOT / 'cmpsp_ros/guidance/mission/feasibility.py'


@pytest.fixture(scope='module')
def sentences():
    """All sentences that answer odometry."""
    answers = {text for path in SOURCES for text in said(path)}
    of_checks = {text for text in said(PRECHECK) if re.search('start.tolerance|waits', text)}
    return answers | of_checks


def on_page(sentence):
    parts = (re.escape(part) for part in sentence.split('…'))
    return re.search(r'[^|`\n]*'.join(parts), PAGE) is not None


def test_the_page_has_every_sentence(sentences):
    assert {'Waiting for odometry on ….', 'The plan meets every constraint.'} <= sentences
    assert [each for each in sorted(sentences) if not on_page(each)] == []
    assert QPStatus.FAILED.value in ' '.join(PAGE.split())


def test_every_sentence_of_the_page_is_one_of_them(sentences):
    listed = {
        row.split('|')[1].strip()
        for row in PAGE.splitlines()
        if row.startswith('| ') and not row.startswith('| It says')
    }
    assert len(listed) > 40
    known = [re.compile('.*'.join(map(re.escape, text.split('…')))) for text in sentences]
    unknown = {each for each in listed if not any(form.fullmatch(each) for form in known)}
    # Put together from two parts.
    assert unknown == {'The constraints contradict each other: … m of slack at ….'}


EXIT_CODES = ROOT / 'doc' / 'reference' / 'exit_codes.md'
COMMANDS = {each.callback.__name__: each.callback for each in app.registered_commands}

USAGE = 2
VARIABLE = {'play': {1}}
"""Codes that a command passes on from the node that it runs."""


def rows():
    """Codes that the table has text for, by command."""
    lines = [
        line.split('|')[1:-1] for line in EXIT_CODES.read_text('utf-8').splitlines() if '|' in line
    ]
    header, _, *body = ([cell.strip() for cell in line] for line in lines)
    codes = [int(each) for each in header[1:]]
    return {
        name.strip('`'): {code for code, cell in zip(codes, cells, strict=True) if cell}
        for name, *cells in body
    }


def codes_in(function, tree):
    """Numbers that a function of a module, or one that it calls there, ends the process with."""
    functions = {each.name: each for each in tree.body if isinstance(each, ast.FunctionDef)}
    found, waiting, known = set(), [function], set()
    while waiting:
        name = waiting.pop()
        known.add(name)
        for node in ast.walk(functions[name]):
            if isinstance(node, ast.Name) and node.id in functions and node.id not in known:
                waiting.append(node.id)
            if isinstance(node, ast.Call):
                called = ast.unparse(node.func)
                given = node.args if called == 'typer.Exit' else []
                given = [*given, *(each.value for each in node.keywords if called == 'exit_on')]
                found |= {
                    each.value
                    for one in given
                    for each in ast.walk(one)
                    if isinstance(each, ast.Constant) and isinstance(each.value, int)
                }
    return found


def test_every_command_has_a_row_and_no_other_has():
    assert list(rows()) == list(COMMANDS)


@pytest.mark.parametrize('name', COMMANDS)
def test_the_codes_of_a_command_are_those_of_its_source(name):
    command = COMMANDS[name]
    source = inspect.getsource(sys.modules[command.__module__])
    found = codes_in(command.__name__, ast.parse(source))
    if name == 'bench':
        text = (ROOT / 'benchmarks' / '__main__.py').read_text('utf-8')
        found |= codes_in('bench', ast.parse(text))
    assert rows()[name] | {USAGE} == found | {0, USAGE} | VARIABLE.get(name, set())


@pytest.mark.parametrize('name', COMMANDS)
def test_codes_that_the_help_names_are_in_the_table(name):
    named = re.findall(r'(?:[Ee]xit code|,|;) (\d)\b', inspect.getdoc(COMMANDS[name]))
    assert {int(each) for each in named} <= rows()[name]


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
