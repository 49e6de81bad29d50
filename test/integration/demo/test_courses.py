"""Roads, goals and obstacles of every kind by `cmpsp demo`, a custom model among them."""

import csv
import json
import math
import os
import re
from pathlib import Path

import pytest

from cmpsp_ros.bags import Bag
from cmpsp_ros.bags.runs import encounters, read_run
from cmpsp_ros.parameters import TABLE, guidance_settings
from cmpsp_ros.robots.motion import REFERENCE_POINT


@pytest.fixture
def drive(start_demo, tmp_path):
    """Drive a preset in lockstep, all steps nominal: `drive(preset, steps)`; folder and summary."""

    def drive(preset, steps, name='run'):
        folder = tmp_path / name
        running = start_demo(preset, '--lockstep', '--output', folder)
        assert running.wait() == 0, running.stderr
        summary = json.loads((folder / 'summary.json').read_text())
        assert summary['levels'] == {'nominal': steps, 'elastic': 0, 'previous_plan': 0, 'stop': 0}
        assert summary['clearance_m'] >= 0.0
        return folder, summary

    return drive


# A road that crosses itself; a thousand points and ten obstacles; shapes on a floor; other models.
@pytest.mark.parametrize(
    ('preset', 'steps'),
    [
        ('corridor', 100),
        ('mapped', 50),
        ('floor', 40),
        ('omni_aisle', 70),
        ('lane_change', 100),
        ('three_point_turn', 100),
        ('parking', 260),
    ],
)
def test_what_stands_still_in_lockstep(drive, judge, preset, steps):
    folder, summary = drive(preset, steps)
    assert summary['miss_m'] < 1e-6
    judge(folder / 'bag')


def test_a_road_from_a_topic_in_lockstep(drive, judge):
    folder, summary = drive('road_topic', 100)
    assert summary['miss_m'] < 1e-6
    said = (folder / 'guidance_node.log').read_text()
    assert said.index('a road of 31 points') < said.index('plan')
    with Bag(folder / 'bag') as bag:
        assert bag.topics['/road'].count == 1
    judge(folder / 'bag')


def test_a_road_without_end_in_lockstep(drive):
    _, summary = drive('endless', 300)
    assert summary['speed_m_s'] == pytest.approx(1.2, rel=0.01)
    assert summary['miss_m'] is None


def test_obstacles_that_move_in_lockstep(drive, judge, tmp_path):
    runs = []
    for name in ('one', 'two'):
        folder, summary = drive('moving', 50, name)
        assert summary['miss_m'] < 1e-3
        runs.append(read_run(folder / 'bag'))
    one, two = runs
    assert {each.id for each in one.tracks} == {0, 1}
    assert [each.points.tolist() for each in one.plans] == [e.points.tolist() for e in two.plans]
    replayed, audited = judge(tmp_path / 'one' / 'bag')
    assert 'identical: ' in replayed
    assert 'moving obstacles clear' in audited


def test_goals_one_after_another_in_lockstep(drive):
    folder, summary = drive('goals', 300)
    assert [each['name'] for each in summary['goals']] == ['a', 'b', 'c', 'd', 'e', 'goal']
    assert all(each['miss_m'] < 1e-6 for each in summary['goals'])
    assert summary['goals'][1]['heading_miss_rad'] < 1e-6
    with Bag(folder / 'bag') as bag:
        *_, (_, shown) = bag.messages('/guidance/markers')
    pale = [each.color.a < 0.5 for each in shown.markers if each.ns == 'goal']
    assert pale == [True] * 5 + [False]


def test_a_course_past_what_moves_in_lockstep(drive, start_demo, start_cmpsp, judge, tmp_path):
    folder, summary = drive('course', 300)
    assert [each['name'] for each in summary['goals']] == ['a', 'b', 'c', 'd', 'e', 'goal']
    assert all(each['miss_m'] < 0.01 for each in summary['goals'])
    run, settings = read_run(folder / 'bag'), recorded_settings(folder)
    assert {each.id for each in run.tracks} == {0, 1, 2}
    begin, end = run.decisions[0].stamp, run.decisions[0].stamp + 60 * 10**9
    driven = run.driven.between(begin, end)
    assert settings.safety.margin > 0.0
    assert min(distances(driven, run.tracks).values()) >= settings.safety.margin
    judge(folder / 'bag')
    check_views(start_cmpsp, folder)
    # Without what moves the robot drives another way: it would have met each of them.
    alone = start_demo(
        'course', '--lockstep', '--output', tmp_path / 'alone',
        '--set', 'moving_obstacles.capacity=0',
    )  # fmt: skip
    assert alone.wait() == 1
    blind = read_run(tmp_path / 'alone' / 'bag').driven.between(begin, end)
    nearest = distances(blind, run.tracks)
    assert len(nearest) == 3
    assert all(each < 0.0 for each in nearest.values()), nearest


def check_views(start_cmpsp, folder):
    """Report and tables show goals and moving obstacles."""
    for command, name in (('report', 'report.html'), ('export', 'tables')):
        arguments = [command, folder / 'bag', '--output', folder / name]
        shown = start_cmpsp(*arguments)
        assert shown.wait() == 0, shown.stderr
    page = (folder / 'report.html').read_text(encoding='utf-8')
    (told,) = re.findall(r'(?s)<script[^>]* id="data">(.*?)</script>', page)
    (bag,) = json.loads(told)['bags']
    labels = ['a at 9 s', 'b at 17 s', 'c at 26 s', 'd at 36 s', 'e at 52 s', 'goal at 60 s']
    assert [each[3] for each in bag['goals']] == labels
    assert [each[0] for each in bag['goals']] == [0.0, 9.0, 17.0, 26.0, 36.0, 52.0]
    assert [each['radius'][0] for each in bag['moving']] == [0.25, 0.25, 0.3]
    with (folder / 'tables' / 'decisions.csv').open(newline='') as file:
        goals = [row['goal'] for row in csv.DictReader(file)]
    assert list(dict.fromkeys(goals)) == ['a', 'b', 'c', 'd', 'e', 'goal']
    with (folder / 'tables' / 'moving.csv').open(newline='') as file:
        assert {row['id'] for row in csv.DictReader(file)} == {'0', '1', '2'}


def recorded_settings(folder):
    with Bag(folder / 'bag') as bag:
        return guidance_settings(TABLE.resolve(bag.parameters['/guidance']))


def distances(driven, tracks):
    """Least distance of a path from each obstacle, by name, as it was told of [m]."""
    nearest = {}
    for each in encounters(driven, tracks, [(REFERENCE_POINT, 0.0)], lambda _: 1.0):
        known = nearest.get(each.name, math.inf)
        nearest[each.name] = min(known, float(each.clearance.min()))
    return nearest


@pytest.mark.parametrize('preset', ['unknown', 'clutter'])
def test_obstacles_that_only_a_scanner_sees_in_lockstep(start_demo, judge, tmp_path, preset):
    folder = tmp_path / 'run'
    running = start_demo(preset, '--lockstep', '--output', folder)
    assert running.wait() == 0, running.stdout + running.stderr
    summary = json.loads((folder / 'summary.json').read_text())
    # By all that stands there.
    assert 0.0 < summary['clearance_m'] < 0.3
    assert summary['miss_m'] < 0.01
    with Bag(folder / 'bag') as bag:
        assert bag.topics['/scan'].count > 250
        assert bag.topics['/guidance/sighting'].count >= 130
    judge(folder / 'bag')


ROOT = Path(__file__).parents[3]


def test_the_fork_lift_of_the_page_in_lockstep(start_demo, judge, tmp_path, monkeypatch):
    page = (ROOT / 'doc' / 'user' / 'your_model.md').read_text(encoding='utf-8')
    code = re.search(r'^```python\n(.*?)^```$', page, re.MULTILINE | re.DOTALL)[1]
    (tmp_path / 'forklift.py').write_text(code)
    given = re.search(r'cmpsp demo (case3_wide .*?)\n```', page, re.DOTALL)[1]
    monkeypatch.setenv('PYTHONPATH', f'{tmp_path}{os.pathsep}{os.environ.get("PYTHONPATH", "")}')
    folder = tmp_path / 'run'
    running = start_demo(*given.replace('\\', '').split(), '--output', folder)
    assert running.wait() == 0, running.stdout + running.stderr
    summary = json.loads((folder / 'summary.json').read_text())
    assert summary['miss_m'] < 1e-3
    assert summary['clearance_m'] > 0.0
    judge(folder / 'bag')


def test_who_looks_at_nobody_touches_no_robot_that_drives(start_demo, judge, tmp_path):
    """He walks up to the robot, and stands against it until it has given way."""
    text = (ROOT / 'config' / 'doorway.yaml').read_text(encoding='utf-8')
    course, folder = tmp_path / 'doorway.yaml', tmp_path / 'run'
    course.write_text(text.rstrip() + '\n          gives_way: false\n', encoding='utf-8')
    running = start_demo(course, '--lockstep', '--output', folder)
    assert running.wait() == 0, running.stderr
    summary = json.loads((folder / 'summary.json').read_text(encoding='utf-8'))
    assert summary['clearance_m'] > 0.0
    judge(folder / 'bag')
