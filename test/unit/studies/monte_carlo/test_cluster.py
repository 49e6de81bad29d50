"""A study on a real Dask cluster of this machine, one worker of which is killed."""

import json
import signal
import subprocess
import sys
import time

import pytest
from commands import command

from cmpsp_ros.studies.monte_carlo import Order, Study, StudyError, run_study
from cmpsp_ros.studies.monte_carlo import run as study_runs
from cmpsp_ros.studies.monte_carlo.outcome import NAME, digest, open_results_log

STUDY = Study('nominal', 1)
RUNS = 48
LIMIT = 250.0


def until(condition):
    end = time.monotonic() + LIMIT
    while not (value := condition()):
        assert time.monotonic() < end, f'not so within {LIMIT} s'
        time.sleep(0.02)
    return value


@pytest.fixture(scope='module')
def start(tmp_path_factory):
    """Start a part of a cluster on loopback: `start('scheduler')`."""
    folder, started = tmp_path_factory.mktemp('dask'), []

    def start(*arguments):
        line = [sys.executable, '-m', 'dask', *map(str, arguments), '--no-dashboard']
        line += ['--host', '127.0.0.1']
        with (folder / f'{len(started)}.log').open('wb') as log:
            started.append(subprocess.Popen(line, cwd=folder, stdout=log, stderr=log))
        return started[-1]

    yield start
    # There is nothing to lose any more, and they take their time to say goodbye.
    for each in reversed(started):
        each.kill()
        each.wait(LIMIT)


@pytest.fixture(scope='module')
def address(start, tmp_path_factory):
    """Address of a running scheduler."""
    file = tmp_path_factory.mktemp('scheduler') / 'scheduler.json'
    start('scheduler', '--port', 0, '--scheduler-file', file)

    def known():
        try:
            return json.loads(file.read_text())['address']
        except (FileNotFoundError, ValueError):
            return None

    return until(known)


def worker(start, address):
    return start('worker', address, '--nthreads', 1, '--no-nanny')


def test_an_address_without_a_worker_is_told(address, monkeypatch, tmp_path):
    monkeypatch.setattr(study_runs, '_ANSWER_TIMEOUT', 0.5)
    with pytest.raises(StudyError, match=rf'found no worker at {address}, wanted one'):
        run_study(Order(STUDY, 2, tmp_path / 'study', scheduler=address), lambda *_: lambda _: None)


@pytest.mark.slow
def test_a_killed_worker_loses_nothing_and_nothing_counts_twice(start, address, tmp_path):
    first, _ = worker(start, address), worker(start, address)
    folder = tmp_path / 'cluster'
    line = [sys.executable, '-m', 'cmpsp_ros.cli', 'study', 'nominal', '--runs', str(RUNS)]
    line += ['--scheduler', address, '--output', str(folder)]
    with subprocess.Popen(line, stdout=subprocess.PIPE, text=True) as study:
        until(lambda: len(numbers_in(folder)) > 0)
        first.send_signal(signal.SIGKILL)
        assert len(numbers_in(folder)) < RUNS
        said, _ = study.communicate(timeout=LIMIT)
    assert study.returncode == 0
    assert f'nominal: {RUNS} runs of seed 1' in said
    assert sorted(numbers_in(folder)) == list(range(RUNS))
    alone = tmp_path / 'alone'
    run_study(Order(STUDY, RUNS, alone), lambda *_: lambda _: None)
    assert (folder / 'summary.json').read_bytes() == (alone / 'summary.json').read_bytes()
    there = [dict(sorted(open_results_log(each, STUDY).items())) for each in (folder, alone)]
    assert there[0] == there[1]


def numbers_in(folder):
    """Numbers of the runs in a results log, as often as they are there."""
    try:
        lines = (folder / NAME).read_text().splitlines()
    except FileNotFoundError:
        return []
    # A line may be looked at while it is being written.
    whole = [each for each in lines if each.startswith('{"number"') and each.endswith('}')]
    return [json.loads(each)['number'] for each in whole]


@pytest.mark.parametrize('address', ['tcp://127.0.0.1:9', 'nonsense://x', 'nowhere'])
def test_no_scheduler_there_is_told_in_one_line(monkeypatch, tmp_path, address):
    monkeypatch.setattr(study_runs, '_ANSWER_TIMEOUT', 0.5)
    arguments = ['study', 'nominal', '--scheduler', address, '--output', str(tmp_path / 'study')]
    result = command(*arguments)
    assert result.exit_code == 1
    assert f'found no answer at {address!r}' in result.output
    assert 'Traceback' not in result.output


def test_without_dask_it_says_what_it_wants(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, 'distributed', None)
    with pytest.raises(StudyError, match='pip install distributed'):
        run_study(Order(STUDY, 2, tmp_path / 'study', scheduler='x'), lambda *_: lambda _: None)


def test_a_worker_with_other_code_makes_nothing():
    other = digest()[::-1]
    with pytest.raises(StudyError, match=f'other code: found {digest()}, wanted {other}'):
        study_runs._make_remotely(STUDY, [0], other)
