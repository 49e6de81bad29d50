"""The launch files name what there is: executables, parameters, arguments, topics and files.

`launch` is not on the Python package index, so they are read here and not run. What they start
is run, by the command lines that it would have, in test/integration/test_launch_commands.py.
"""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from cmpsp_ros.parameters.catalogue import TABLE
from cmpsp_ros.parameters.table import is_of_ros

ROOT = Path(__file__).parents[2]
FILES = sorted((ROOT / 'launch').glob('*.launch.py'))
USUAL = {'namespace', 'use_sim_time', 'params_file', 'robot_file', 'log_level'}
OF_RECORDER = {'output', 'own_topics'}

by_file = pytest.mark.parametrize('file', FILES, ids=lambda file: file.name)


def calls(file, name):
    """All calls of a class, in their order."""
    tree = ast.parse(file.read_text(encoding='utf-8'))
    found = [each for each in ast.walk(tree) if isinstance(each, ast.Call)]
    return [each for each in found if isinstance(each.func, ast.Name) and each.func.id == name]


def keyword(call, name):
    """A keyword's value as source; None without."""
    return next((ast.unparse(each.value) for each in call.keywords if each.arg == name), None)


def texts(node):
    return [
        each.value
        for each in ast.walk(node)
        if isinstance(each, ast.Constant) and isinstance(each.value, str)
    ]


def declared(file):
    return {each.args[0].value: each for each in calls(file, 'DeclareLaunchArgument')}


def executables():
    setup = (ROOT / 'setup.py').read_text(encoding='utf-8')
    return set(re.findall(r"'(\w+) = cmpsp_ros\.", setup))


def test_there_are_two():
    assert [file.name for file in FILES] == ['demo.launch.py', 'guidance.launch.py']


@by_file
def test_it_has_the_usual_arguments_described(file):
    arguments = declared(file)
    assert set(arguments) >= USUAL
    for call in arguments.values():
        assert keyword(call, 'default_value') is not None
        assert keyword(call, 'description')


def test_guidance_can_record_and_show():
    assert set(declared(ROOT / 'launch/guidance.launch.py')) == {*USUAL, 'record', 'rviz', 'view'}


@by_file
def test_every_argument_used_is_declared_and_every_one_declared_is_used(file):
    used = {each.args[0].value for each in calls(file, 'LaunchConfiguration')}
    assert used == set(declared(file))


@by_file
def test_every_node_is_an_executable_of_the_package_and_tells_its_level(file):
    nodes = calls(file, 'Node')
    assert nodes
    for node in nodes:
        package, executable = (keyword(node, name) for name in ('package', 'executable'))
        if package == "'rviz2'":
            assert executable == "'rviz2'"
            continue
        assert package == "'cmpsp_ros'"
        assert ast.literal_eval(executable) in executables()
        assert 'log_level' in keyword(node, 'arguments') or keyword(node, 'arguments') == 'LOGGING'


@by_file
def test_every_parameter_exists(file):
    known = OF_RECORDER | TABLE.resolve({}).keys()
    for node in calls(file, 'Node'):
        for each in ast.walk(node):
            if isinstance(each, ast.Dict):
                keys = {key.value for key in each.keys}
                assert all(key in known or is_of_ros(key) for key in keys), keys


@by_file
def test_files_that_it_names_are_installed(file):
    named = set()
    for call in calls(file, 'PathJoinSubstitution'):
        parts = [text for text in texts(call) if text != 'cmpsp_ros']
        if 'CONFIG' in ast.unparse(call):
            parts.insert(0, 'config')
        named.add('/'.join(parts))
    assert named >= {'config/case3.yaml'}
    for path in named:
        assert (ROOT / path).exists(), path


def test_the_demo_includes_guidance():
    (call,) = calls(ROOT / 'launch/demo.launch.py', 'IncludeLaunchDescription')
    assert texts(call) == ['launch', 'guidance.launch.py']


def test_rviz_is_told_the_topics_of_a_namespace():
    (rviz,) = (
        each
        for each in calls(ROOT / 'launch/guidance.launch.py', 'Node')
        if keyword(each, 'package') == "'rviz2'"
    )
    names = {text for text in texts(rviz) if text.startswith('/')}
    layout = (ROOT / 'config/cmpsp.rviz').read_text(encoding='utf-8')
    assert names == set(re.findall(r'Value: (/\S+)', layout))


@by_file
def test_it_imports_only_what_it_needs_of_launch(file):
    imports = [
        each
        for each in ast.walk(ast.parse(file.read_text(encoding='utf-8')))
        if isinstance(each, ast.ImportFrom)
    ]
    assert {each.module.partition('.')[0] for each in imports} == {'launch', 'launch_ros'}
    source = file.read_text(encoding='utf-8')
    for each in imports:
        for name in each.names:
            assert source.count(name.name) > 1
