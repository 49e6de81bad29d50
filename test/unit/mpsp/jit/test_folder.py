"""Where machine code is kept, and that only what belongs to these sources and this user is used."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numba
import pytest

from cmpsp_ros.mpsp.jit import cache
from cmpsp_ros.mpsp.jit import folder as folder_module
from cmpsp_ros.mpsp.jit.folder import PACKAGE, kernel_folder, kernel_sources, old_folders

KERNEL = """
from cmpsp_ros.mpsp.jit.compiled import compiled
from cmpsp_ros.mpsp.jit.cache import kernel_folder


@compiled
def double(x):
    return 2 * x


print(double(4), sum(double.stats.cache_hits.values()), kernel_folder())
"""


@pytest.fixture
def environment(tmp_path, monkeypatch):
    """A home and a temporary folder that are empty; `environment(NAME=value)` sets variables."""
    for name in ('NUMBA_CACHE_DIR', 'XDG_CACHE_HOME'):
        monkeypatch.delenv(name, raising=False)
    for name, folder in (('HOME', 'home'), ('TMPDIR', 'tmp')):
        (tmp_path / folder).mkdir()
        monkeypatch.setenv(name, str(tmp_path / folder))
    monkeypatch.setattr('tempfile.tempdir', None)
    kernel_folder.cache_clear()
    yield lambda **values: [monkeypatch.setenv(name, str(each)) for name, each in values.items()]
    kernel_folder.cache_clear()


@pytest.fixture
def run(tmp_path, environment):
    """Run a program with one kernel as a process; returns the words it says."""
    path = tmp_path / 'kernel.py'
    path.write_text(KERNEL)

    def run_program():
        done = subprocess.run(
            [sys.executable, str(path)], capture_output=True, text=True, check=True
        )
        assert done.stderr == ''
        return done.stdout.split()

    return run_program


def test_it_is_in_the_user_s_cache(environment, tmp_path):
    folder = kernel_folder()
    assert folder.parent == tmp_path / 'home' / '.cache' / 'cmpsp_ros'
    assert folder.name.startswith('kernels-')
    assert folder.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize('name', ['XDG_CACHE_HOME', 'NUMBA_CACHE_DIR'])
def test_it_goes_where_the_user_says(environment, tmp_path, name):
    environment(**{name: tmp_path / 'elsewhere'})
    assert kernel_folder().parent == tmp_path / 'elsewhere' / 'cmpsp_ros'


def test_without_a_place_of_one_s_own_it_is_below_the_temporary_files(environment, tmp_path):
    (tmp_path / 'file').touch()
    environment(NUMBA_CACHE_DIR=tmp_path / 'file')
    assert kernel_folder().parent == tmp_path / 'tmp' / f'cmpsp_ros-{os.getuid()}'


def test_a_folder_that_others_may_write_to_is_not_used(environment, tmp_path):
    open_to_all = tmp_path / 'home' / '.cache' / 'cmpsp_ros'
    open_to_all.mkdir(parents=True)
    open_to_all.chmod(0o777)
    assert kernel_folder().is_relative_to(tmp_path / 'tmp')


def test_nor_one_that_leads_elsewhere(environment, tmp_path):
    (tmp_path / 'other').mkdir(mode=0o700)
    (tmp_path / 'home' / '.cache').mkdir()
    (tmp_path / 'home' / '.cache' / 'cmpsp_ros').symlink_to(tmp_path / 'other')
    assert kernel_folder().is_relative_to(tmp_path / 'tmp')


@pytest.mark.skipif(os.getuid() != 0, reason='only root can give a folder away')
def test_nor_one_of_another_user(environment, tmp_path):
    folder = kernel_folder()
    kernel_folder.cache_clear()
    os.chown(folder, 12345, 12345)
    assert kernel_folder().is_relative_to(tmp_path / 'tmp')


def test_without_any_place_kernels_are_compiled_all_the_same(run, environment, tmp_path):
    (tmp_path / 'file').touch()
    environment(NUMBA_CACHE_DIR=tmp_path / 'file')
    (tmp_path / 'tmp' / f'cmpsp_ros-{os.getuid()}').touch()
    assert run() == ['8', '0', 'None']
    assert run() == ['8', '0', 'None']


def test_files_cut_short_are_compiled_anew_and_mended(run):
    folder = Path(run()[2])
    (file,) = [*folder.glob('*/kernel.double-*')]
    whole = file.read_bytes()
    for length in (0, 10, len(whole) // 2, len(whole) - 1):
        file.write_bytes(whole[:length])
        assert run()[:2] == ['8', '0']
        assert run()[:2] == ['8', '1']
    assert [*folder.glob('*/*')] == [file]


def test_a_kernel_is_found_beside_one_for_a_class_that_cannot_be_imported(environment, tmp_path):
    (tmp_path / 'kernel.py').write_text(
        'from typing import NamedTuple\n'
        'from cmpsp_ros.mpsp.jit.compiled import compiled\n'
        'class Own(NamedTuple):\n    x: int\n'
        '@compiled\ndef double(x):\n    return 2 * x.x\n'
        'def hits(x):\n    double(x)\n    print(sum(double.stats.cache_hits.values()))\n'
    )
    mine = tmp_path / 'mine.py'
    mine.write_text('from typing import NamedTuple\nclass Mine(NamedTuple):\n    x: int\n')
    own = 'import kernel; kernel.hits(kernel.Own(4))'
    program = 'import kernel, mine; kernel.hits(mine.Mine(4))'

    def hits(code):
        done = subprocess.run(
            [sys.executable, '-c', code], cwd=tmp_path, capture_output=True, text=True, check=True
        )
        return done.stdout

    assert [hits(own), hits(program), hits(own), hits(program)] == ['0\n', '0\n', '1\n', '1\n']
    mine.unlink()
    assert hits(own) == '1\n'


def test_bitcode_is_read_only_for_what_is_compiled_against_it(environment, tmp_path):
    (tmp_path / 'kernel.py').write_text(
        'import numba\n'
        'from cmpsp_ros.mpsp.jit.compiled import compiled\n'
        '@compiled\ndef double(x):\n    return 2 * x\n'
        '@numba.njit\ndef four_times(x):\n    return double(double(x))\n'
    )
    program = 'from kernel import *; print(double(4), sum(double.stats.cache_hits.values()))\n'
    subprocess.run([sys.executable, '-c', program], cwd=tmp_path, check=True)
    program += 'loaded = double.overloads[double.signatures[0]].library\n'
    program += 'print(type(loaded.bitcode).__name__)\n'
    program += 'print(four_times(4), type(loaded.bitcode).__name__)'
    done = subprocess.run(
        [sys.executable, '-c', program], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stdout == '8 1\nbytes\n16 NoneType\n'


def test_what_numba_keeps_for_others_is_loaded_as_ever(environment, tmp_path):
    (tmp_path / 'kernel.py').write_text(
        'import numba\n'
        'from cmpsp_ros.mpsp.jit.compiled import compiled\n'
        '@compiled\ndef double(x):\n    return 2 * x\n'
        '@numba.njit(cache=True)\ndef treble(x):\n    return 3 * x\n'
    )
    program = 'from kernel import *\n'
    program += 'for f in (double, treble): print(f(4), sum(f.stats.cache_hits.values()))'

    def said():
        command = [sys.executable, '-c', program]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
        return done.stdout.splitlines()

    assert [said(), said()] == [['8 0', '12 0'], ['8 1', '12 1']]


def test_a_folder_that_vanishes_in_between_does_no_harm(environment, tmp_path):
    def function(x):
        return x + 1

    dispatcher = numba.njit(function)
    kernel_cache.enable_cache(dispatcher, function)
    for each in [*kernel_folder().glob('**/*')]:
        each.rmdir()
    kernel_folder().rmdir()
    assert dispatcher(1) == 2


def test_a_copy_of_the_package_finds_what_another_compiled(environment, tmp_path):
    program = 'from cmpsp_ros.robot.arcs import arc_from as f; f(0.0, 0.0, 0.0, 1.0, 1.0);'
    program += 'print(sum(f.stats.cache_hits.values()), f.__code__.co_filename)'
    said = []
    for name in ('first', 'second'):
        shutil.copytree(PACKAGE, tmp_path / name / PACKAGE.name)
        command = [sys.executable, '-c', program]
        done = subprocess.run(
            command, cwd=tmp_path / name, capture_output=True, text=True, check=True
        )
        said.append(done.stdout.split())
    places = [str(tmp_path / name / PACKAGE.name / 'robot/arcs.py') for name in ('first', 'second')]
    assert said == [['0', places[0]], ['1', places[1]]]


def test_processes_that_compile_at_once_lose_nothing_of_each_other_s(environment, tmp_path):
    names = [f'T{i}' for i in range(4)]
    (tmp_path / 'kernel.py').write_text(
        'from typing import NamedTuple\n'
        'from cmpsp_ros.mpsp.jit.compiled import compiled\n'
        + ''.join(f'class {name}(NamedTuple):\n    x: int\n' for name in names)
        + '@compiled\ndef double(x):\n    return 2 * x.x\n'
    )
    program = 'import kernel, sys\nfor name in sys.argv[1:]: kernel.double(vars(kernel)[name](4))\n'
    program += 'print(sum(kernel.double.stats.cache_hits.values()))'
    command = [sys.executable, '-c', program]
    at_once = [subprocess.Popen([*command, name], cwd=tmp_path) for name in names]
    assert [each.wait() for each in at_once] == [0] * len(names)
    done = subprocess.run(
        [*command, *names], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stdout == f'{len(names)}\n'


def test_a_changed_program_of_somebody_else_s_is_compiled_anew(run, tmp_path):
    assert run()[:2] == ['8', '0']
    path = tmp_path / 'kernel.py'
    path.write_text(path.read_text().replace('2 * x', '3 * x'))
    assert run()[:2] == ['12', '0']
    assert run()[:2] == ['12', '1']


def test_every_kernel_s_file_counts_and_what_it_imports():
    sources = kernel_sources()
    for path in PACKAGE.rglob('*.py'):
        text = path.read_text()
        if '\n@compiled\n' in text or '\n@implements(' in text:
            assert path.relative_to(PACKAGE).as_posix() in sources
    some = {'mpsp/compiled.py', 'mpsp/kernel_cache.py', 'robot/differential_drive.py'}
    assert some <= set(sources)
    assert not any(each.startswith('nodes/') for each in sources)


def test_a_changed_source_is_another_folder(environment, tmp_path, monkeypatch):
    package = tmp_path / 'cmpsp_ros'
    (package / 'mpsp').mkdir(parents=True)
    monkeypatch.setattr(folder_module, 'PACKAGE', package)
    mark = 'from cmpsp_ros.mpsp.jit.compiled import compiled\n'
    files = {
        'mpsp/kernel.py': f'{mark}from cmpsp_ros.mpsp import constants\n',
        'mpsp/constants.py': 'from cmpsp_ros.mpsp.units import (\n    METRE,\n)\n',
        'mpsp/units.py': 'METRE = 1.0\n',
        'mpsp/other.py': '',
    }
    for name, source in files.items():
        (package / name).write_text(source)

    def folder():
        kernel_folder.cache_clear()
        return kernel_folder()

    first = folder()
    assert folder() == first
    (package / 'mpsp/other.py').write_text('OTHER = 1\n')
    assert folder() == first
    (package / 'mpsp/units.py').write_text('METRE = 2.0\n')
    second = folder()
    assert second != first
    assert old_folders() == [first]
