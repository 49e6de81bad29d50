"""An empty cache for each test, and programs that are run as processes."""

import subprocess
import sys
import types

import pytest

from cmpsp_ros.mpsp.jit import kernel_folder


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
def folder(environment):
    """The folder of kernels in this process."""
    return kernel_folder()


@pytest.fixture
def start(tmp_path, environment):
    """Start a program, given as source, in a process of its own."""

    def start_program(source, *arguments, name='program.py'):
        path = tmp_path / name
        path.write_text(source)
        command = [sys.executable, str(path), *arguments]
        pipe = subprocess.PIPE
        return subprocess.Popen(command, cwd=tmp_path, stdout=pipe, stderr=pipe, text=True)

    return start_program


@pytest.fixture
def run(start):
    """Run a program, given as source; returns the words it says."""

    def run_program(source, *arguments):
        said, problems = start(source, *arguments).communicate(timeout=250.0)
        assert problems == ''
        return said.split()

    return run_program


@pytest.fixture
def module():
    """Make a module of source text, which is in no file."""

    def make(source, name='somewhere', **names):
        made = types.ModuleType(name)
        vars(made).update(names)
        exec(compile(source, f'<{name}>', 'exec'), vars(made))
        return made

    return make
