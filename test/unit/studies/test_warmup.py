"""`cmpsp warmup`: once it has run, processes find their machine code."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

CMPSP = [sys.executable, '-m', 'cmpsp_ros.cli']

pytestmark = pytest.mark.timeout(300)


@pytest.fixture
def run(tmp_path):
    """Run the command in an environment of its own: `run(NAME=value)`."""
    for name in ('home', 'tmp'):
        (tmp_path / name).mkdir()
    plain = {'NO_COLOR': '1', 'COLUMNS': '200', 'TERM': 'dumb'}
    own = {'HOME': str(tmp_path / 'home'), 'TMPDIR': str(tmp_path / 'tmp'), **plain}
    inherited = {
        k: v for k, v in os.environ.items() if k not in ('NUMBA_CACHE_DIR', 'XDG_CACHE_HOME')
    }

    def run_command(**env):
        env = {**inherited, **own, **{name: str(value) for name, value in env.items()}}
        command = [*CMPSP, 'warmup']
        return subprocess.run(command, env=env, capture_output=True, text=True, check=False)

    return run_command


def test_the_second_time_everything_is_there(run, tmp_path):
    caches = tmp_path / 'home' / '.cache' / 'cmpsp_ros'
    old = caches / 'kernels-of-before'
    old.mkdir(parents=True, mode=0o700)
    caches.chmod(0o700)
    first = run()
    assert first.returncode == 0, first.stderr
    assert 'kernels compiled' in first.stdout
    assert 'removed: machine code of 1 other version(s)' in first.stdout
    assert not old.exists()
    (folder,) = caches.iterdir()
    assert f'kept in: {folder}' in first.stdout
    assert [*folder.glob('*/*.nbc')]
    assert first.stderr == ''

    second = run()
    assert second.returncode == 0, second.stderr
    assert 'kernels compiled' not in second.stdout
    assert second.stdout.count('all there') == first.stdout.count('kernels compiled')
    assert 'removed' not in second.stdout


def test_a_folder_that_cannot_be_written_is_told(run, tmp_path):
    (tmp_path / 'file').touch()
    (tmp_path / 'tmp' / f'cmpsp_ros-{os.getuid()}').touch()
    done = run(NUMBA_CACHE_DIR=tmp_path / 'file')
    assert done.returncode == 1
    (said,) = done.stderr.splitlines()
    assert said.startswith(f'{tmp_path}/file/cmpsp_ros is no folder that only you can write to')
    assert 'nothing is kept (NUMBA_CACHE_DIR)' in said
