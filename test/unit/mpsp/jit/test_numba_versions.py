"""The oldest numba that setup.py admits, and the newest there is, pass the tests of this folder."""

import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
ROOT = HERE.parents[3]
NEEDED = ['casadi', 'hypothesis', 'pytest<9.2', 'pytest-timeout', 'scipy']


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize('versions', [('numba==0.62.0', 'numpy==1.26.*'), ('numba', 'numpy')])
def test_a_version_passes_the_tests_of_this_folder(tmp_path, monkeypatch, versions):
    monkeypatch.setenv('PYTHONPATH', str(ROOT))
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tmp_path / 'cache'))
    python = tmp_path / 'venv' / 'bin' / 'python'
    options = ['-p', 'no:cacheprovider', '-q', '-m', 'not slow']
    for command in (
        [sys.executable, '-m', 'venv', tmp_path / 'venv'],
        [python, '-m', 'pip', 'install', '--quiet', *versions, *NEEDED],
        [python, '-m', 'pytest', *options, HERE],
    ):
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
