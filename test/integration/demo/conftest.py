"""Runs of `cmpsp demo`, each on a domain of its own."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture
def start_cmpsp(spawn):
    """Start the command line: `start_cmpsp('audit', bag)`."""
    return lambda *args, **env: spawn([sys.executable, '-m', 'cmpsp_ros.cli', *args], **env)


@pytest.fixture
def start_demo(start_cmpsp):
    """Start a demo: `start_demo('case3', '--lockstep', ...)`."""
    return lambda *args, **env: start_cmpsp('demo', *args, **env)


@pytest.fixture
def judge(start_cmpsp):
    """Have a bag replayed and audited, which must find nothing; what both said."""

    def judge(bag):
        said = []
        for command in ('replay', 'audit'):
            judged = start_cmpsp(command, bag)
            assert judged.wait() == 0, judged.stdout + judged.stderr
            said.append(' '.join(judged.stdout.split()))
        return said

    return judge
