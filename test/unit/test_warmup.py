"""`cmpsp warmup`: once it has run, processes find their machine code."""

import os
import shutil
import subprocess
import sys
import time

import pytest

from cmpsp_ros.mpsp.jit import kernel_folder

CMPSP = [sys.executable, '-m', 'cmpsp_ros.cli']

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]


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


@pytest.fixture
def caches(tmp_path):
    """A cache in which the machine code of some files is missing, and a file nobody has used."""
    caches = tmp_path / 'home' / '.cache' / 'cmpsp_ros'
    caches.mkdir(parents=True, mode=0o700)
    folder = kernel_folder()
    # Others may compile meanwhile, and remove their locks.
    shutil.copytree(folder, caches / folder.name, ignore=shutil.ignore_patterns('*.lock'))
    for each in ('guidance.safety.plan_sweep', 'mpsp.qp.dense.condensing'):
        missing = [*(caches / folder.name).glob(f'cmpsp_ros.{each}.*')]
        assert missing
        for file in missing:
            file.unlink()
    with (caches / folder.name / 'unused.kernel').open('wb') as unused:
        unused.truncate(500_000_000)
    os.utime(unused.name, (time.time() - 31 * 86_400.0,) * 2)
    return caches


def test_the_second_time_everything_is_there(run, caches):
    first = run()
    assert first.returncode == 0, first.stderr
    assert 'kernels compiled' in first.stdout
    assert 'removed: 1 files not used for 30 days' in first.stdout
    (folder,) = caches.iterdir()
    assert f'kept in: {folder}' in first.stdout
    assert [*folder.glob('cmpsp_ros.guidance.safety.plan_sweep.*')]
    assert not (folder / 'unused.kernel').exists()
    assert first.stderr.startswith('Compiling kernels (once): 1: ')

    second = run()
    assert second.returncode == 0, second.stderr
    assert 'kernels compiled' not in second.stdout
    assert second.stderr == ''
    # The solver, each kind of road with and without what moves, the simulated scanner, and the
    # method for any problem.
    assert second.stdout.count('all there') == 9
    assert 'removed' not in second.stdout


def test_without_a_folder_that_can_be_written_nothing_is_compiled_for_nothing(run, tmp_path):
    (tmp_path / 'file').touch()
    (tmp_path / 'tmp' / f'cmpsp_ros-{os.getuid()}').touch()
    done = run(NUMBA_CACHE_DIR=tmp_path / 'file')
    assert done.returncode == 1
    (said,) = done.stderr.splitlines()
    assert said.startswith(f'{tmp_path}/file/cmpsp_ros is no folder that only you can write to')
    assert 'nothing would be kept (NUMBA_CACHE_DIR)' in said
    assert 'compiled' not in done.stdout
