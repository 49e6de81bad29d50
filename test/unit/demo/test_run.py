"""The start of a run: its folder, its domain, its processes, and nodes that are not there."""

import os
import signal
import socket
import subprocess
import sys

import pytest

from cmpsp_ros.demo import Child, DemoError, make_folder, processes


def test_a_new_folder_is_made_with_its_parents(tmp_path):
    folder = tmp_path / 'a' / 'b'
    assert make_folder(folder, force=False) == folder
    assert folder.is_dir()


def test_an_existing_folder_is_refused_and_left_alone(tmp_path):
    (tmp_path / 'summary.json').write_text('{}')
    with pytest.raises(DemoError, match='found an existing folder, wanted a new one; --force'):
        make_folder(tmp_path, force=False)
    assert (tmp_path / 'summary.json').exists()


def test_force_removes_an_earlier_run_and_nothing_else(tmp_path):
    (tmp_path / 'bag').mkdir()
    for name in ('bag/bag.mcap', 'summary.json', 'trajectory.png', 'sim_node.log', 'mine.txt'):
        (tmp_path / name).write_text('x')
    (tmp_path / 'bags').mkdir()
    make_folder(tmp_path, force=True)
    assert {each.name for each in tmp_path.iterdir()} == {'mine.txt', 'bags'}
    make_folder(tmp_path / 'new', force=True)
    assert (tmp_path / 'new').is_dir()


@pytest.mark.parametrize('force', [True, False])
@pytest.mark.parametrize('inside', [True, False])
def test_a_file_in_the_way_is_told_and_stays(tmp_path, force, inside):
    file = tmp_path / 'file'
    file.write_text('mine')
    with pytest.raises(DemoError, match=str(file)):
        make_folder(file / 'run' if inside else file, force=force)
    assert file.read_text() == 'mine'


def test_without_a_name_it_is_the_time_and_latest_points_at_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'runs' / 'old').mkdir(parents=True)
    (tmp_path / 'runs' / 'latest').symlink_to('old')
    folder = make_folder(None, force=False)
    assert folder.parent.name == 'runs'
    assert folder.is_dir()
    latest = tmp_path / 'runs' / 'latest'
    assert latest.is_symlink()
    assert latest.resolve() == folder.resolve()


def test_a_domain_that_is_claimed_or_in_use_is_passed_over(monkeypatch):
    monkeypatch.setenv('ROS_DOMAIN_ID', '0')
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'SUBNET')
    first = processes.use_free_domain()
    assert os.environ['ROS_DOMAIN_ID'] == str(first)
    assert os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'LOCALHOST'
    # The last one chosen is claimed, and no other of this process.
    second = processes.use_free_domain()
    assert second != first
    with socket.socket(type=socket.SOCK_DGRAM) as taken:
        # That of its first participant.
        taken.bind(('127.0.0.1', 7400 + 250 * first + 10))
        assert processes.use_free_domain() not in {first, second}


# What is registered for a fork stays for the life of a process.
INTERRUPTED = """
import os, pathlib, signal, sys
from cmpsp_ros.demo.processes import Child
number = signal.Signals(int(sys.argv[1]))
def interrupt(number, frame):
    raise KeyboardInterrupt
signal.signal(number, interrupt)
os.register_at_fork(after_in_parent=lambda: signal.raise_signal(number))
try:
    Child.start('recorder', [], pathlib.Path(sys.argv[2]))
except KeyboardInterrupt:
    print('interrupted', signal.getsignal(number) is interrupt)
"""


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_an_interruption_while_a_node_is_started_is_not_forgotten(tmp_path, number):
    command = [sys.executable, '-c', INTERRUPTED, str(int(number)), str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=100, check=True)
    assert (done.stdout, done.stderr) == ('interrupted True\n', '')


WORDS = 'compiling, once; `cmpsp warmup` does it beforehand'


@pytest.fixture
def child(tmp_path):
    """A process that says something and stays, or ends: `child(code)`."""
    started = []

    def start(code=''):
        log = tmp_path / 'guidance_node.log'
        log.write_text(f'{WORDS}\n')
        command = [sys.executable, '-c', code or 'input()']
        process = subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.DEVNULL)
        started.append(process)
        if code:
            process.wait(100.0)
        return Child('guidance_node', process, log)

    yield start
    for process in started:
        process.kill()
        process.communicate()


def no_answer():
    raise TimeoutError('no answer within 30 s')


@pytest.mark.parametrize(
    ('code', 'change', 'said'),
    [
        ('', no_answer, r'no answer within 30 s; it said:\ncompiling'),
        ('raise SystemExit(3)', no_answer, 'guidance_node ended with exit code 3'),
        ('', lambda: False, r'guidance_node refuses to start:\ncompiling'),
    ],
)
def test_a_node_that_does_not_become_ready_is_told_with_its_words(child, code, change, said):
    with pytest.raises(DemoError, match=said):
        child(code).ask('refuses to start', change)


def test_a_node_that_compiles_is_waited_for_while_it_lives(child, capsys):
    node = child()
    node.log.write_text('[INFO] [guidance]: Compiling kernels (once): 12: solve\n')
    assert node.still_compiles()
    assert capsys.readouterr().err == 'guidance_node: Compiling kernels (once): 12: solve\n'
    node.log.write_text('[INFO] [guidance]: compiled 240 kernels in 61.0 s\n')
    assert not node.still_compiles()
    assert not child('raise SystemExit(3)').still_compiles()
