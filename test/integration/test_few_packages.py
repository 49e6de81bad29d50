"""Nodes where only the packages are installed that they need; programs that miss one say so."""

import os
import re
import subprocess
import sys
from importlib.metadata import distributions
from pathlib import Path

import pytest
from geometry_msgs.msg import Twist

from cmpsp_ros.nodes import MODULES

ROOT = Path(__file__).parents[2]
NEEDED = {'numpy', 'scipy', 'numba', 'llvmlite', 'pyyaml', 'lark-parser'}
ABSENT = ('rosbags', 'qpsolvers', 'clarabel', 'daqp', 'rich', 'typer', 'matplotlib', 'PIL')

pytestmark = pytest.mark.smoke


def linked(folder, wanted):
    """Environment in which `python -S` sees this project and the wanted packages alone."""
    for each in distributions():
        if wanted(each.metadata['Name'].lower()):
            for top in {file.parts[0] for file in each.files or ()} - {'..', '__pycache__'}:
                if not (link := folder / top).is_symlink():
                    link.symlink_to(each.locate_file(top))
    return {'PYTHONPATH': os.pathsep.join([str(ROOT), str(folder)])}


@pytest.fixture(scope='module')
def few(tmp_path_factory):
    folder = tmp_path_factory.mktemp('few')
    return linked(folder, lambda name: name in NEEDED or name.startswith('ros-'))


@pytest.fixture(scope='module')
def without_ros(tmp_path_factory):
    return linked(
        tmp_path_factory.mktemp('others'), lambda name: not name.startswith(('ros-', 'rclpy'))
    )


def run(few, code):
    command = [sys.executable, '-S', '-c', code]
    environment = {**os.environ, **few}
    return subprocess.run(
        command, env=environment, capture_output=True, text=True, timeout=100, check=False
    )


def test_those_packages_are_absent(few):
    code = f'from importlib.util import find_spec; print([*filter(find_spec, {ABSENT})])'
    assert run(few, code).stdout == '[]\n'


def test_a_robot_drives(few, spawn, ros):
    twists = []
    ros.node.create_subscription(Twist, '/cmd_vel', twists.append, 10)
    given = ['--ros-args', '--params-file', ROOT / 'config' / 'case3.yaml', '-p', 'autostart:=true']
    for name in ('sim_node', 'guidance_node'):
        spawn([sys.executable, '-S', '-m', MODULES[name], *given], **few)
    ros.spin_until(lambda: len(twists) > 5 and twists[-1].linear.x > 0.5, 100.0)


@pytest.mark.parametrize(
    ('program', 'missing'), [('cmpsp', 'typer'), ('recorder', 'rosbags'), ('viewer', 'pillow')]
)
def test_a_program_says_what_to_install(few, program, missing):
    done = run(few, f'from cmpsp_ros.programs import {program}; {program}()')
    assert done.returncode == 1
    assert f'-m pip install {missing}`' in done.stderr
    assert 'Traceback' not in done.stderr


@pytest.mark.parametrize('verb', ['play', 'record', 'view'])
def test_without_ros_a_live_verb_says_so(without_ros, tmp_path, verb):
    bag = [str(tmp_path)] if verb == 'play' else []
    code = f'import sys; sys.argv[1:] = {[verb, *bag]}; from cmpsp_ros.cli import __main__'
    done = run(without_ros, code)
    assert done.returncode == 1
    assert re.fullmatch(
        'found no .*: source a ROS 2, or `pip install cmpsp_ros.ros.`\n', done.stderr
    )


def test_the_solver_is_named_that_is_not_installed(few):
    done = run(few, "from cmpsp_ros.mpsp.qp import backend; backend('daqp')")
    assert "qp: found 'daqp', wanted one of riccati_active_set, hildreth;" in done.stderr
    assert '`pip install daqp qpsolvers clarabel` adds others' in done.stderr
