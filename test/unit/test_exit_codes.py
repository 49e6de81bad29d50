"""The table of exit codes names every command, and the codes that its source has."""

import ast
import inspect
import re
import sys
from pathlib import Path

import pytest

from cmpsp_ros.cli import app

ROOT = Path(__file__).parents[2]
PAGE = ROOT / 'doc' / 'reference' / 'exit_codes.md'
COMMANDS = {each.callback.__name__: each.callback for each in app.registered_commands}

USAGE = 2
VARIABLE = {'play': {1}}
"""Codes that a command passes on from the node that it runs."""


def rows():
    """Codes that the table has text for, by command."""
    lines = [line.split('|')[1:-1] for line in PAGE.read_text('utf-8').splitlines() if '|' in line]
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
