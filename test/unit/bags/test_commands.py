"""Commands for bags: exit codes, files, and one clear line when things go wrong."""

import subprocess
import sys

import pytest
from commands import command
from hidden_robots import Hidden, record

from cmpsp_ros.bags import BagWriter

TWIST = 'geometry_msgs/msg/Twist'


@pytest.fixture
def bag(tmp_path):
    with BagWriter(tmp_path / 'bag') as bag:
        bag.topic('/cmd_vel', TWIST)
        bag.write('/cmd_vel', 1, b'\x00\x01\x00\x00' + bytes(48))
    return tmp_path / 'bag'


def test_recover(bag, tmp_path):
    (bag / 'metadata.yaml').unlink()
    done = command('recover', bag)
    assert done.exit_code == 0
    assert done.stdout == f'{tmp_path}/bag_recovered: 1 messages of 1 topics\n'
    assert done.stderr == ''


@pytest.mark.parametrize('form', ['csv', 'parquet'])
def test_export(bag, tmp_path, form):
    folder = tmp_path / 'tables'
    done = command('export', bag, '--output', folder, '--format', form)
    assert done.exit_code == 0
    assert done.stdout == f'{folder}/commands.{form}: 1 rows\n'
    assert (folder / f'commands.{form}').exists()


@pytest.mark.parametrize(
    ('args', 'reason'),
    [
        (('recover', 'bag', '--output', 'bag'), 'bag: exists already'),
        (('export', 'bag', '--output', 'bag'), 'bag: exists already'),
        (('record', '--output', 'bag'), 'bag: exists already'),
        (('record', '--all', '--topic', '/a'), '--all and --topic: wanted one or the other'),
        (
            ('record', '--storage', 'sqlite3', '--compression', 'zstd'),
            '--compression zstd: only mcap can be compressed, not sqlite3',
        ),
        (('record', '--storage', 'rosbag1'), "'rosbag1' is not one of 'mcap', 'sqlite3'"),
    ],
)
def test_refused(bag, monkeypatch, args, reason):
    monkeypatch.chdir(bag.parent)
    done = command(*args)
    assert done.exit_code == 2
    assert reason in done.stderr
    assert 'Traceback' not in done.output
    assert [each.name for each in bag.parent.iterdir()] == ['bag']


@pytest.mark.ros
def test_recorder_and_export_load_no_compiled_code():
    """A recorder must be small beside the nodes, and a command start at once."""
    code = 'import sys, cmpsp_ros.bags.export, cmpsp_ros.nodes.recording.recorder'
    done = subprocess.run(
        [sys.executable, '-c', f'{code}; print("numba" in sys.modules)'],
        capture_output=True,
        text=True,
        check=True,
        timeout=100,
    )
    assert done.stdout == 'False\n'


def test_a_clean_drive_is_exit_code_0(drive, tmp_path):
    done = command('audit', drive.write(tmp_path / 'bag'), '--junit', tmp_path / 'audit.xml')
    assert done.exit_code == 0, done.output
    assert 'Path: clear of obstacles' in done.output
    assert 'No margin was asked for' in done.output
    assert (tmp_path / 'audit.xml').exists()


def test_a_wrong_command_is_exit_code_1(drive, tmp_path):
    drive.commands[drive.at(4.0)].twist += [0.0, 0.01]
    done = command('audit', drive.write(tmp_path / 'bag'))
    assert done.exit_code == 1
    assert 'failed Commands: as decided: 1 of 53 commands' in done.output


def test_a_bag_that_lacks_data_is_exit_code_3(drive, tmp_path):
    done = command('audit', drive.until(4.1).write(tmp_path / 'bag'))
    assert done.exit_code == 3
    assert 'not judged Path: goal at the final time: The recording ends 5.9 s' in done.output


def test_a_bag_of_another_robot_is_audited_by_a_file(drive, tmp_path):
    drive = drive.without_node()
    drive.odom = 'wheels/odom'
    bag = drive.write(tmp_path / 'bag')
    done = command('audit', bag, '--odom', '/wheels/odom', '--params-file', 'case3')
    assert done.exit_code == 0, done.output


def test_a_bag_gives_a_table_a_file_and_a_picture(tmp_path):
    bag = record(tmp_path / 'bag', Hidden())
    done = command('identify', bag)
    assert done.exit_code == 0, done.output
    for words in ('wheel lag', 'command_delay', 'linear speed limit: not identifiable: not'):
        assert words in done.output
    folder = tmp_path / 'bag_identified'
    assert (folder / 'identify.png').read_bytes()[:4] == b'\x89PNG'
    assert 'command_delay: 0.2' in (folder / 'robot.yaml').read_text(encoding='utf-8')
    again = command('identify', bag)
    assert again.exit_code == 2
    assert 'exists already; --force replaces it' in again.output
    assert command('identify', bag, '--force').exit_code == 0


@pytest.mark.ros
def test_nothing_to_identify_is_exit_code_2(tmp_path):
    for arguments, words in (
        ((), 'found none, wanted a bag, or --drive'),
        ((tmp_path / 'no', '--output', tmp_path / 'out'), 'no such bag'),
        (('--drive', '--max-speed', '3.0', '--output', tmp_path / 'fast'), 'found a way of'),
    ):
        done = command('identify', *arguments)
        assert (done.exit_code, words in done.output) == (2, True), done.output


@pytest.mark.ros
def test_nobody_is_driven_without_a_yes(tmp_path):
    done = command('identify', '--drive', '--output', tmp_path / 'out')
    assert done.exit_code != 0
    assert 'Is it clear for 1 m around it? [y/N]' in done.output
    assert not (tmp_path / 'out' / 'bag').exists()


def test_it_says_what_it_wrote(drive, tmp_path):
    bag, output = drive.write(tmp_path / 'bag'), tmp_path / 'drive.html'
    done = command('report', bag, bag, '--output', output)
    assert done.exit_code == 0, done.output
    assert f'{output}: written' in done.output
    assert f'{output.with_suffix(".png")}: written' in done.output
    again = command('report', bag, '--output', output)
    assert again.exit_code == 2
    assert '--force replaces it' in again.stderr
    assert command('report', bag, '--output', output, '--force').exit_code == 0
