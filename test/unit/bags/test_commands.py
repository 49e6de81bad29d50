"""`cmpsp record`, `recover` and `export`: exit codes, and one clear line when things go wrong."""

import subprocess
import sys

import pytest
from commands import command

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
