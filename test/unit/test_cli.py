"""The `cmpsp` command: arguments in, exit code and words out."""

import errno
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import typer
from commands import command

from cmpsp_ros import demo
from cmpsp_ros.bags import BagError
from cmpsp_ros.cli.terminal import writing_to
from cmpsp_ros.demo import DemoError, Summary


def summary(**changes):
    values = {
        'preset': 'case3',
        'reached': True,
        'miss': 1e-9,
        'clearance': 0.01,
        'max_wheel_speed': 51.0,
        'step_times': {'p50': 1.0, 'p99': 2.0, 'max': 3.0},
        'deadline_misses': 0,
        'levels': {'nominal': 50, 'elastic': 0, 'previous_plan': 0, 'stop': 0},
        'control_steps': 50,
    }
    return Summary(**{**values, **changes})


@pytest.fixture
def invoke():
    """Run the command: `invoke('demo', 'case3')`."""
    before = signal.getsignal(signal.SIGTERM)
    yield command
    signal.signal(signal.SIGTERM, before)


@pytest.fixture
def outcome(monkeypatch):
    """Have a run come to this: a summary or an exception."""

    def set_outcome(result):
        def run(robots, folder, progress, view_port):
            if isinstance(result, BaseException):
                raise result
            return (result,)

        monkeypatch.setattr(demo, 'run', run)

    return set_outcome


def words(text):
    return ' '.join(re.sub(r'\x1b\[[0-9;]*m', '', text).split())


def test_help_names_every_command_and_option(invoke):
    result = invoke('--help')
    assert result.exit_code == 0
    assert 'demo' in result.output
    result = invoke('demo', '--help')
    assert result.exit_code == 0
    for option in (
        '--robot',
        '--lockstep',
        '--output',
        '--set',
        'KEY=VALUE',
        '--force',
        '[preset]',
    ):
        assert option.lower() in words(result.output).lower()
    assert 'Exit code 0 only if' in words(result.output)


def test_help_lists_the_commands_in_the_order_of_their_use(invoke):
    listed = re.findall(r'^  ([a-z]+)  ', invoke('--help').stdout, re.MULTILINE)
    assert listed == [
        'demo', 'audit', 'bench', 'paper', 'study', 'export', 'film', 'identify', 'record',
        'recover', 'replay', 'report', 'play', 'view', 'warmup',
    ]  # fmt: skip


def test_it_starts_without_what_only_some_commands_need():
    heavy = "{'numba', 'numpy', 'rosbags', 'rclpy', 'matplotlib', 'daqp', 'rich', 'yaml'}"
    # typer 0.9 itself imports rich
    code = (
        'import sys, typer; before = {*sys.modules}; import cmpsp_ros.cli;'
        f'print(sorted({heavy} & (sys.modules.keys() - before)))'
    )
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert done.stdout == '[]\n'


@pytest.mark.parametrize('args', [(), ('drive',), ('demo', '--fast'), ('demo', 'case3', 'case2')])
def test_a_wrong_command_line_is_exit_code_2(invoke, args):
    assert invoke(*args).exit_code == 2


def test_what_a_chosen_robot_changes_is_said_before_the_run(invoke, outcome, tmp_path):
    outcome(DemoError('nothing was driven'))
    args = ('demo', 'case3', '--robot', 'turtlebot3_burger', '--output', tmp_path / 'run')
    said = words(invoke(*args).stderr)
    assert said.index('s instead of 10 s: this robot drives') < said.index('nothing was driven')
    refused = invoke('demo', '--robot', 'jakal', '--output', tmp_path / 'other')
    assert refused.exit_code == 2
    assert 'did you mean jackal?' in words(refused.stderr)


@pytest.mark.parametrize(
    ('result', 'code', 'said'),
    [
        (summary(reached=False, miss=0.5), 1, 'the goal was missed by 0.5 m'),
        (summary(clearance=-0.1), 1, 'the path cut road edge or obstacle by 0.1 m'),
        (summary(apart=-0.1), 1, 'the robot touched another by 0.1 m'),
        (DemoError('sim_node ended with exit code -9:\n[last] words'), 1, '[last] words'),
        (OSError(errno.ENOSPC, 'No space left on device'), 1, 'run: cannot be written: No space'),
        (BagError('bag: cut off'), 3, 'bag: cut off'),
    ],
)
def test_a_bad_run_says_why_and_whether_it_was_judged(
    invoke, outcome, tmp_path, result, code, said
):
    outcome(result)
    done = invoke('demo', '--output', tmp_path / 'run')
    assert done.exit_code == code
    assert said in words(done.stderr)
    assert said not in words(done.stdout)


def test_a_run_that_is_not_recorded_is_exit_code_3(invoke, outcome, tmp_path):
    lacking = {'not_judged': 'the path is not recorded from 3.00 to 6.00 s (3.00 s)'}
    outcome(summary(**lacking))
    done = invoke('demo', '--output', tmp_path / 'run')
    assert done.exit_code == 3
    assert 'not judged: the path is not recorded from 3.00 to 6.00 s' in words(done.stderr)
    outcome(summary(clearance=-0.1, **lacking))
    assert invoke('demo', '--output', tmp_path / 'other').exit_code == 1


def test_what_a_full_disk_refuses_names_the_folder(tmp_path, capfd):
    with pytest.raises(typer.Exit) as ended, writing_to(tmp_path):
        Path('/dev/full').write_text('x')
    assert ended.value.exit_code == 1
    assert f'{tmp_path}: cannot be written: No space left on device' in capfd.readouterr().err
    # Anything else is a fault of ours.
    with pytest.raises(IsADirectoryError), writing_to(tmp_path):
        tmp_path.write_text('x')


WITHOUT_PSUTIL = """
import sys
sys.modules['psutil'] = None
from cmpsp_ros.cli import main
main()
"""


def test_benchmarks_without_what_they_need_say_what_installs_it():
    done = run_python(WITHOUT_PSUTIL, 'bench', 'case1', '--runs', '1')
    assert done.returncode == 2
    assert done.stderr.strip() == (
        'bench: found no module psutil: `make setup` installs what benchmarks need'
    )


def run_python(program, *arguments):
    command = [sys.executable, '-c', program, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=100, check=False)
