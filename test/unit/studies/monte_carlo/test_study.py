"""Whole studies: the same whoever makes them in whatever order, and never begun from nothing."""

import json
import math
import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from commands import command
from pyarrow import parquet

import cmpsp_ros
from cmpsp_ros.studies.monte_carlo import Order, Study, StudyError, judging, run_study
from cmpsp_ros.studies.monte_carlo.guesses import slalom
from cmpsp_ros.studies.monte_carlo.outcome import HASHED_PACKAGES, NAME, open_results_log
from cmpsp_ros.studies.monte_carlo.run import make_runs
from cmpsp_ros.studies.monte_carlo.summary import wilson_interval

STUDY = Study('nominal', 1)
RUNS = 10


def results_of(folder):
    return dict(sorted(open_results_log(folder, STUDY).items()))


@pytest.fixture(scope='module')
def made(tmp_path_factory):
    """A study of one process, by the command."""
    folder = tmp_path_factory.mktemp('study') / 'nominal'
    result = command('study', 'nominal', '--runs', RUNS, '--output', folder)
    assert result.exit_code == 0, result.output
    return folder, result.stdout


def test_a_study_counts_keeps_and_draws(made):
    folder, printed = made
    assert f'nominal: {RUNS} runs of seed 1' in printed
    assert 'arrived within 1 mm, goal in reach' in printed
    assert 'miss [m]' in printed
    values = json.loads((folder / 'summary.json').read_text())
    assert sum(values['verdicts'].values()) == values['runs'] == RUNS
    share = values['shares']['left the road']
    assert share['of'] == RUNS
    assert share['wilson_95'][0] <= share['count'] / RUNS <= share['wilson_95'][1]
    assert sum(values['control_steps'].values()) == 50 * RUNS
    table = parquet.read_table(folder / 'runs.parquet')
    assert table.column('number').to_pylist() == list(range(RUNS))
    outcomes = results_of(folder)
    assert table.column('miss').to_pylist() == [each.miss for each in outcomes.values()]
    assert table.column('verdict').to_pylist().count('arrived') == values['verdicts']['arrived']
    for picture in ('paths.png', 'spread.png'):
        assert (folder / picture).read_bytes().startswith(b'\x89PNG')
    drawn = {each.name for each in folder.glob('failures/*')}
    assert drawn == {f'run_{each["run"]:05d}.png' for each in values['failures']}


def test_the_digest_covers_every_package_that_decides():
    root = Path(cmpsp_ros.__file__).parent
    assert all(list((root / package).rglob('*.py')) for package in HASHED_PACKAGES)


@pytest.mark.parametrize(
    ('count', 'total', 'interval'),
    [
        # R. G. Newcombe, Two-sided confidence intervals for the single proportion, Stat. Med. 17
        # (1998), table I, method 3.
        (81, 263, (0.2553, 0.3662)),
        (15, 148, (0.0624, 0.1605)),
        (0, 20, (0.0, 0.1611)),
        (1, 29, (0.0061, 0.1718)),
        (0, 0, (0.0, 1.0)),
    ],
)
def test_intervals_are_the_published_ones(count, total, interval):
    assert wilson_interval(count, total) == pytest.approx(interval, abs=5e-5)


@pytest.mark.slow
def test_of_two_hundred_robots_none_is_unsafe_and_nearly_all_arrive(tmp_path):
    """The study of `cmpsp study nominal`, with other courses than those of the documentation."""
    study = Study('nominal', 7)
    values = run_study(
        Order(study, 200, tmp_path / 'nominal', workers=2), lambda *_: lambda _: None
    )
    counts = {name: each['count'] for name, each in values['shares'].items()}
    arrived = values['shares']['arrived within 1 mm, goal in reach']
    assert arrived['count'] >= 0.95 * arrived['of'] > 80
    unsafe = ('touched an obstacle, of runs with any', 'left the road', 'exceptions')
    assert [counts[name] for name in unsafe] == [0, 0, 0]
    assert values['verdicts']['command not finite'] == 0
    assert values['verdicts']['command above the wheel limit'] == 0


@pytest.mark.slow
def test_two_workers_come_to_the_same(made, tmp_path):
    folder = tmp_path / 'nominal'
    told = []
    run_study(Order(STUDY, RUNS, folder, workers=2), lambda *_: told.append)
    assert results_of(folder) == results_of(made[0])
    assert (folder / 'summary.json').read_bytes() == (made[0] / 'summary.json').read_bytes()
    assert sum(told) >= RUNS


def test_any_order_comes_to_the_same(made, tmp_path):
    folder = tmp_path / 'nominal'
    open_results_log(folder, STUDY)
    outcomes = list(make_runs(Order(STUDY, 0, folder), [7, 3, 5], lambda _: None))
    assert [each.number for each in outcomes] == [7, 3, 5]
    kept = results_of(made[0])
    assert outcomes == [kept[7], kept[3], kept[5]]
    assert results_of(folder) == {number: kept[number] for number in (3, 5, 7)}


@pytest.mark.slow
def test_after_a_kill_it_goes_on_and_loses_nothing(made, tmp_path):
    folder = tmp_path / 'nominal'
    line = [sys.executable, '-m', 'cmpsp_ros.cli', 'study', 'nominal']
    arguments = [*line, '--runs', '400', '--workers', '2', '--output', str(folder)]
    with subprocess.Popen(arguments, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as child:
        deadline = time.monotonic() + 250.0
        while len(finished := lines_of(folder)) < 4 and time.monotonic() < deadline:
            time.sleep(0.01)
        os.kill(child.pid, signal.SIGKILL)
    finished = lines_of(folder)
    assert 4 <= len(finished) < 400
    # The workers end with their parent: nothing is added any more.
    time.sleep(1.0)
    after = lines_of(folder)
    time.sleep(1.0)
    assert lines_of(folder) == after
    assert after[: len(finished)] == finished
    there = results_of(folder)
    assert len(there) >= len(finished)
    missing = [number for number in range(RUNS) if number not in there]
    told = []
    run_study(Order(STUDY, RUNS, folder), lambda part, _: told.append if part == 'runs' else len_of)
    assert told == [RUNS - len(missing), *[1] * len(missing)]
    kept = results_of(folder)
    assert {number: kept[number] for number in range(RUNS)} == results_of(made[0])


@pytest.mark.slow
def test_an_interrupt_ends_it_with_a_word_on_how_to_go_on(tmp_path, interruptible):
    folder = tmp_path / 'nominal'
    line = [sys.executable, '-m', 'cmpsp_ros.cli', 'study', 'nominal', '--runs', '400']
    arguments = [*line, '--workers', '2', '--output', str(folder)]
    with interruptible():
        child = subprocess.Popen(arguments, stderr=subprocess.PIPE, text=True)
    with child:
        deadline = time.monotonic() + 250.0
        while len(lines_of(folder)) < 2 and time.monotonic() < deadline:
            time.sleep(0.01)
        child.send_signal(signal.SIGINT)
        _, said = child.communicate(timeout=250)
    assert child.returncode == 130
    assert said.splitlines()[-1] == f'{folder}: interrupted; the same command continues'
    assert 'Traceback' not in said
    assert 2 <= len(results_of(folder)) < 400


@pytest.mark.slow
@pytest.mark.parametrize('is_of_all', [False, True], ids=['alone', 'as in a terminal'])
def test_an_interrupt_does_not_wait_for_runs_that_take_minutes(tmp_path, interruptible, is_of_all):
    folder = tmp_path / 'people'
    line = [sys.executable, '-m', 'cmpsp_ros.cli', 'study', 'people', '--seen', '--robot', 'own']
    arguments = [*line, '--scene', 'hall', '--runs', '40', '--workers', '2', '--output', folder]
    with interruptible():
        child = subprocess.Popen(
            arguments, stderr=subprocess.PIPE, text=True, start_new_session=True
        )
    with child:
        deadline = time.monotonic() + 250.0
        while len(lines_of(folder)) < 1 and time.monotonic() < deadline:
            time.sleep(0.05)
        (os.killpg if is_of_all else os.kill)(child.pid, signal.SIGINT)
        _, said = child.communicate(timeout=30)
    assert child.returncode == 130
    assert said.splitlines()[-1] == f'{folder}: interrupted; the same command continues'
    assert 'Traceback' not in said


def test_a_run_is_repeated_by_the_command_as_a_shell_reads_it():
    given = Study('people', 3, 4, ('sim.scan.pose=[0.05, 0.0, 0.0]',), 'my robot.yaml', seen=True)
    words = shlex.split(given.command(7))
    assert words[:8] == ['cmpsp', 'study', 'people', '--seed', '3', '--run', '7', '--robot']
    assert words[8:] == ['my robot.yaml', '--seen', '--set', 'sim.scan.pose=[0.05, 0.0, 0.0]']


def len_of(_):
    return None


def lines_of(folder):
    """Whole lines of finished runs, the head left out."""
    try:
        text = (folder / NAME).read_text()
    except FileNotFoundError:
        return []
    return [each for each in text.splitlines() if each.startswith('{"number"') and each[-1] == '}']


def test_what_a_power_cut_left_of_a_line_is_made_again(made, tmp_path):
    path = tmp_path / NAME
    content = (made[0] / NAME).read_bytes().rstrip()
    path.write_bytes(content[:-30])
    last = next(number for number in range(RUNS) if number not in open_results_log(tmp_path, STUDY))
    list(make_runs(Order(STUDY, 0, tmp_path), [last], lambda _: None))
    assert results_of(tmp_path) == results_of(made[0])


@pytest.mark.parametrize(
    ('change', 'text'),
    [
        (('--seed', 2), 'found other seed, wanted the same, or another folder'),
        (('--obstacles', 6), 'found other obstacles'),
        (('--set', 'weights.road_center=1.0'), 'found other parameters'),
    ],
)
def test_another_study_does_not_go_on_in_its_folder(made, change, text):
    result = command('study', 'nominal', '--runs', 2, '--output', made[0], *change)
    assert result.exit_code == 1
    assert text in result.output
    assert len(result.stderr.strip().splitlines()) == 1


def test_a_folder_with_something_else_is_left_alone(tmp_path):
    (tmp_path / 'mine').write_text('mine')
    with pytest.raises(StudyError, match='found something else there'):
        open_results_log(tmp_path, STUDY)
    (tmp_path / NAME).write_text('what\n')
    with pytest.raises(StudyError, match='found other code, study, seed'):
        open_results_log(tmp_path, STUDY)
    with pytest.raises(StudyError, match=r'mine: found something else there'):
        open_results_log(tmp_path / 'mine', STUDY)


@pytest.mark.parametrize(
    ('arguments', 'text'),
    [
        (('nominall',), "study: found 'nominall', wanted one of nominal, disturbed, realtime"),
        (('nominal', '--set', 'robot.radios=1'), 'robot.radios'),
        (('nominal', '--set', 'obstacles.names=[a]'), 'obstacles.a.center'),
        (('nominal', '--run', 3, '--set', 'final_time=x'), 'final_time'),
        (('nominal', '--runs', 0), '--runs'),
        (('nominal', '--seed', -1), '--seed'),
        (('nominal', '--obstacles', 7), '--obstacles'),
        ((), 'NAME'),
        (('people', '--set', 'sim.people.legs=true'), 'sim.people.legs: found in --set'),
        (('people', '--set', 'final_time=9.0'), 'final_time: found in --set'),
        (('people', '--robot', 'car'), 'robot.radius: found 3.764 m, wanted less than'),
        (('sight', '--told'), 'found study sight, wanted people'),
        (('nominal', '--robot', 'nope'), "'nope': found no such robot"),
    ],
)
def test_bad_input_is_told(tmp_path, arguments, text):
    result = command('study', *arguments, '--output', tmp_path / 'study')
    assert result.exit_code == 2
    assert text in result.output
    assert 'Traceback' not in result.output
    assert not (tmp_path / 'study').exists()


def test_one_run_again(made, tmp_path):
    result = command('study', 'nominal', '--run', 7, '--output', tmp_path)
    assert result.exit_code == 0, result.output
    kept = results_of(made[0])[7]
    assert f'{kept.verdict(1e-3)}: miss {kept.miss:.3g} m' in result.stdout
    assert (tmp_path / 'run_00007.png').read_bytes().startswith(b'\x89PNG')
    assert '0.00 s  ' in result.stdout


def test_the_judge_finds_a_way_where_there_is_one(tmp_path):
    assert judging.judge_failure(STUDY.run(next_arrived()))['answer'] == judging.FEASIBLE
    blocked = Study('nominal', 1, 0, ('robot.max_wheel_speed=0.5',)).run(0)
    assert judging.judge_failure(blocked) == {'answer': judging.OUT_OF_REACH}
    path = tmp_path / judging.JUDGED
    assert judging.read_answers(path) == {}
    judging.write_answers(path, {3: {'answer': judging.NOT_FOUND}})
    assert judging.read_answers(path) == {3: {'answer': judging.NOT_FOUND}}
    path.write_text('[1]')
    with pytest.raises(StudyError, match=r'judged\.json'):
        judging.read_answers(path)


def test_the_judge_passes_a_goal_near_an_obstacle_and_keeps_the_margin():
    task = Study('disturbed', 1).run(502)
    near = min(math.dist(task.settings.goal, o.center) - o.radius for o in task.settings.obstacles)
    assert 0.05 < near < 0.08
    found = judging.judge_failure(task)
    assert found['answer'] == judging.FEASIBLE
    assert found['clearance_m'] >= 0.05 - 1e-6


def next_arrived():
    """The first run of which the goal is in reach."""
    for number in range(100):
        task = STUDY.run(number)
        way = task.settings.road.shortest_length(task.scenario.pose[:2], task.settings.goal)
        if way < 0.8 * judging.farthest(task):
            return number
    raise AssertionError


def test_without_casadi_the_judge_says_what_it_wants(monkeypatch):
    monkeypatch.setitem(sys.modules, 'casadi', None)
    with pytest.raises(StudyError, match='pip install casadi'):
        judging.judge_failure(STUDY.run(next_arrived()))


def test_a_start_for_the_judge_passes_obstacles_where_there_is_room():
    task = Study('nominal', 2).run(224)
    points = slalom(task.settings, np.array(task.scenario.pose)).points()
    for each in task.settings.obstacles:
        assert np.linalg.norm(points - each.center, axis=1).min() > each.radius
    assert points[-1] == pytest.approx(task.settings.goal)


def test_each_heavy_robot_has_a_lag_of_its_own():
    lags = [Study('heavy').run(number).plant.wheel_lag for number in range(20)]
    assert min(lags) >= 0.1
    assert max(lags) <= 0.3
    assert len(set(lags)) == 20
    assert Study('heavy').run(3).plant.wheel_lag == lags[3]
    # The law is told of none.
    assert (
        Study('heavy').run(3).settings
        == Study('heavy', assignments=('wheel_lag=0.2',)).run(3).settings
    )
