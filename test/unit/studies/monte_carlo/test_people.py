"""Runs among people: what is drawn, and how contacts are judged."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from cmpsp_ros.simulator import Motion, PeopleSettings, Walker
from cmpsp_ros.studies.monte_carlo import Order, Study, StudyError
from cmpsp_ros.studies.monte_carlo.contacts import (
    ALL_HELD,
    OUTSIDE,
    TOO_FAST,
    TOO_LATE,
    TOO_SHARP,
    clearance,
    contacts,
)
from cmpsp_ros.studies.monte_carlo.courses.crowds import SCENES
from cmpsp_ros.studies.monte_carlo.driving import DrivenRun, drive, outcome
from cmpsp_ros.studies.monte_carlo.outcome import StudyOutcome, open_results_log
from cmpsp_ros.studies.monte_carlo.run import make_runs
from cmpsp_ros.studies.monte_carlo.summary import figures
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import Capsule
from cmpsp_ros.world.roads import OpenFloor


@pytest.mark.parametrize('scene', SCENES)
def test_everybody_begins_clear_of_walls_and_of_the_robot(scene):
    study = Study('people', scene=scene)
    for number in range(8):
        task = study.run(number)
        assert task.crowd.scene == scene
        people = task.people().at(0)
        space = FreeSpace.of(OpenFloor(), task.scenario.obstacles, 0.25)
        assert space.at(people[:, :3])[:, 2:].min() > 0.0
        assert np.hypot(*(people[:, :2] - task.scenario.pose[:2]).T).min() > 1.5


def test_scenes_and_robots_take_turns_and_every_fourth_turn_is_noisy():
    crowds = [Study('people').run(number).crowd for number in range(60)]
    assert len({(each.scene, each.robot) for each in crowds[:15]}) == 15
    assert [each.is_noisy for each in crowds] == [False] * 45 + [True] * 15
    noisy = Study('people').run(45)
    assert noisy.scanner.missed_return == 0.3
    assert noisy.plant.odometry.position_stddev > 0.0


def test_options_that_do_not_fit_are_named():
    with pytest.raises(StudyError, match=r"--scene: found 'attic', wanted one of hall"):
        Study('people', scene='attic').values()
    with pytest.raises(StudyError, match='found study nominal, wanted people'):
        Study('nominal', told=True).values()
    with pytest.raises(StudyError, match='--told, --seen: found both, wanted one of them'):
        Study('people', told=True, seen=True).values()


def test_a_robot_that_is_told_arrives():
    study = Study('people', scene='hall', robot='own', told=True)
    made = outcome(drive(study.run(0)))
    assert made.miss <= study.tolerance
    assert StudyOutcome.from_values(json.loads(made.to_json())) == made


def test_what_was_not_driven_has_no_figure(tmp_path):
    study = Study('people', scene='hall', robot='own', seen=True)
    open_results_log(tmp_path / 'seen', study)
    made = list(make_runs(Order(study, 1, tmp_path / 'seen'), [0], lambda _: None))
    found = figures(study, made, {}, {})['people']['groups']['all']
    assert found['arrived'] == 1
    assert (found['arrived_told'], found['time_by_told'], found['time_by_empty']) == (None,) * 3


def test_a_run_that_takes_too_long_ends_at_rest_and_not_blind():
    """The law would put its final time off again, and nobody looks for people any more."""
    limit = ('robot.max_wheel_acceleration=25.0',)
    task = Study('people', scene='hall', robot='own', told=True, assignments=limit).run(0)
    driven = drive(replace(task, patience=4.0))
    assert any(np.any(each.twist) for each in driven.motions if each.stamp_ns < 4_000_000_000)
    assert not any(np.any(each.twist) for each in driven.motions if each.stamp_ns > 7_000_000_000)


def test_a_robot_brakes_from_the_final_time_on():
    driven = drive(Study('people', scene='hall', robot='own', told=True).run(0))
    ending = next(k for k, each in enumerate(driven.motions) if each.stamp_ns == driven.end)
    at_once = [each for each in driven.motions[ending:] if each.stamp_ns == driven.end]
    assert driven.motions[ending - 1].twist[0] > 0.5
    assert at_once[-1].twist[0] < driven.motions[ending - 1].twist[0] - 0.1


def past(walker, speed, walls=(), acceleration=50.0):
    """A robot that drives straight on from the origin, whoever is there."""
    task = Study('people', scene='hall', robot='own').run(0)
    people = PeopleSettings((walker,), acceleration)
    scenario = replace(task.scenario, people=people, obstacles=tuple(walls))
    driven = DrivenRun(replace(task, scenario=scenario))
    driven.walking = driven.task.people()
    driven.walking.begin(0)
    for number in range(250):
        stamp, x = number * 20_000_000, number * 0.02 * speed
        pose = np.array([x, 0.0, 0.0])
        driven.motions.append(Motion(stamp, pose, np.zeros(2), np.array([speed, 0.0])))
        driven.walking.advance(stamp, np.array([[100.0, 100.0]]), 0.1)
        driven.people.append((stamp, driven.walking.at(stamp)))
    return driven


def test_clearance_is_that_of_both_paths():
    driven = past(Walker('a', (2.0, 0.0), speed=0.0), 0.5)
    near = clearance(driven)[:, 0]
    radius = driven.task.settings.robot_radius
    assert near[0] == pytest.approx(2.0 - 0.25 - radius - 0.01, abs=1e-6)
    (met,) = contacts(driven, ['a'])
    assert met.is_active
    assert met.speed == 0.5
    assert met.time == pytest.approx((2.0 - 0.25 - radius) / 0.5, abs=0.03)


def test_a_robot_at_rest_is_not_the_one_that_drives():
    (met,) = contacts(past(Walker('a', (2.0, 0.0), heading=math.pi, speed=1.0), 0.0), ['a'])
    assert not met.is_active
    assert met.reason == ''


def walked(walker, patience, moves, near=None):
    """A run past one person by `moves(seconds)`: heading, way and speed; they heed it if near."""
    task = Study('people', scene='hall', robot='own').run(0)
    scenario = replace(task.scenario, people=PeopleSettings((walker,), patience), obstacles=())
    driven = DrivenRun(replace(task, scenario=scenario))
    driven.walking = driven.task.people()
    driven.walking.begin(0)
    for number in range(200):
        stamp, (heading, way, speed) = number * 20_000_000, moves(number * 0.02)
        pose = np.array([way, 0.0, heading])
        driven.motions.append(Motion(stamp, pose, np.zeros(2), np.array([speed, 0.0])))
        place = pose[None, :2] if near else np.array([[100.0, 100.0]])
        driven.walking.advance(stamp, place, task.settings.robot_radius)
        driven.people.append((stamp, driven.walking.at(stamp)))
    return driven


@pytest.mark.parametrize(('speed', 'is_active'), [(-0.5, False), (0.04, False), (0.5, True)])
def test_a_robot_that_was_run_into_may_leave_and_not_drive_on(speed, is_active):
    """Somebody walks at the standing robot from ahead, and stops there; after 1.5 s it drives."""
    walker = Walker('a', (1.5, 0.0), heading=math.pi, speed=1.0, gives_way=False)

    def moves(seconds):
        since = max(seconds - 1.5, 0.0)
        return 0.0, speed * since, speed if since > 0.0 else 0.0

    driven = walked(walker, 50.0, moves, near=True)
    (met,) = contacts(driven, ['a'])
    assert met.is_active == is_active


STANDS = Walker('a', (2.0, 0.0), speed=0.0)
WALL = Capsule('wall', (1.2, 0.35), (1.2, 3.0), 0.05)


@pytest.mark.parametrize(
    ('walker', 'speed', 'walls', 'reason'),
    [
        (STANDS, 0.5, (), ALL_HELD),
        (Walker('a', (9.0, 0.0), heading=math.pi, speed=1.9), 0.5, (), TOO_FAST),
        (Walker('a', (2.0, 0.0), heading=math.pi, speed=1.0), 0.5, (), TOO_SHARP),
        (Walker('a', (-1.0, 0.0), speed=0.0), -0.5, (), OUTSIDE),
        (Walker('a', (1.6, 0.8), 'waypoints', waypoints=(1.6, -2.0)), 0.9, (WALL,),
         TOO_LATE),
    ],
)  # fmt: skip
def test_the_assumption_that_did_not_hold_is_named(walker, speed, walls, reason):
    (met,) = contacts(past(walker, speed, walls, 1.0 if walls else 50.0), ['a'])
    assert met.reason == reason


@pytest.mark.parametrize(('distance', 'reason'), [(2.0, OUTSIDE), (3.5, ALL_HELD)])
def test_whoever_comes_into_view_is_seen_when_the_tracker_has_confirmed_them(distance, reason):
    """Somebody walks at the back of a robot, which turns and sees them from 1 s on."""
    walker = Walker('a', (-distance, 0.0), speed=1.0, gives_way=False)
    driven = walked(walker, 1.0, lambda seconds: (math.pi if seconds > 1.0 else 0.0, 0.0, 0.2))
    (met,) = contacts(driven, ['a'])
    assert met.is_active
    assert met.reason == reason
