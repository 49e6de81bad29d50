"""One run: its figures are those of the true path, and nothing that happens ends the study."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from cmpsp_ros.guidance import GuidanceLaw
from cmpsp_ros.simulator import Plant
from cmpsp_ros.studies.monte_carlo import Study
from cmpsp_ros.studies.monte_carlo.driving import drive, farthest, outcome
from cmpsp_ros.studies.monte_carlo.outcome import RunVerdict, StudyOutcome
from cmpsp_ros.world.obstacles import Obstacle

START = (0.0, -9.25, 0.0)


@pytest.fixture
def task():
    made = Study('nominal').run(0)
    scenario = replace(made.scenario, pose=START, obstacles=())
    return replace(
        made,
        scenario=scenario,
        settings=replace(made.settings, obstacles=()),
        plant=replace(made.plant, initial_pose=START),
    )


def test_a_good_run(task):
    made = outcome(drive(task))
    assert made.verdict(1e-3) == RunVerdict.ARRIVED
    assert made.miss < 1e-9
    assert made.obstacle_clearance is None
    assert 0.0 < made.road_clearance <= 0.25
    assert (made.nominal, made.elastic, made.previous_plan, made.stop) == (50, 0, 0, 0)
    assert (made.trouble, made.trouble_time, made.exception) == ('', None, '')
    assert made.max_wheel_speed <= 51.0
    assert len(made.x) == len(made.y) == 51
    assert math.dist((made.x[-1], made.y[-1]), (10.0, 0.0)) == made.miss


def test_a_start_in_an_obstacle_has_begun_outside_and_touches(task):
    obstacles = (Obstacle('o', (0.0, -9.25), 0.2),)
    scenario = replace(task.scenario, obstacles=obstacles)
    settings = replace(task.settings, obstacles=obstacles)
    made = outcome(drive(replace(task, scenario=scenario, settings=settings)))
    assert made.began_outside
    assert made.clearance == made.obstacle_clearance <= -0.2 + 1e-12
    assert made.verdict(1e-3) == RunVerdict.TOUCHED


def test_an_exception_is_kept_and_stops_the_robot(task, monkeypatch):
    law = GuidanceLaw.step

    def step(self, seen):
        if seen.stamp >= 2_000_000_000:
            raise ZeroDivisionError('of\nall things')
        return law(self, seen)

    monkeypatch.setattr(GuidanceLaw, 'step', step)
    driven = drive(task)
    made = outcome(driven)
    assert made.exception == 'ZeroDivisionError: of all things'
    assert made.verdict(1e-3) == RunVerdict.EXCEPTION
    assert driven.motions[-1].wheel_speeds.tolist() == [0.0, 0.0]
    assert made.nominal == 10
    assert made.x[11] == made.x[-1]


@pytest.mark.parametrize(
    ('scale', 'verdict'), [(math.nan, RunVerdict.NOT_FINITE), (2.0, RunVerdict.TOO_FAST)]
)
def test_commands_that_must_not_be_are_counted(task, scale, verdict):
    driven = drive(task)
    *before, last = driven.decisions
    wrong = last._replace(wheel_speeds=last.wheel_speeds * scale, twist=last.twist * scale)
    made = outcome(replace(driven, decisions=[*before, wrong]))
    assert made.verdict(1e-3) == verdict
    assert made.not_finite + made.too_fast == 1


def test_what_cannot_be_reached_is_known(task):
    far = replace(task.scenario, pose=(-10.0, 0.5, -math.pi / 2.0))
    made = outcome(
        drive(replace(task, scenario=far, plant=replace(task.plant, initial_pose=far.pose)))
    )
    assert made.out_of_reach
    assert made.verdict(1e-3) in {RunVerdict.TOO_FAR, RunVerdict.STOPPED}


def test_the_farthest_way_is_what_the_plant_drives(task):
    disturbed = Study('disturbed').run(0)
    line = replace(disturbed.plant, initial_pose=(0.0, 0.0, 0.0), cmd_vel_timeout=0.0)
    plant = Plant(line)
    plant.command(0, line.robot.max_speed, 0.0)
    plant.advance(10_000_000_000)
    assert farthest(disturbed) == pytest.approx(plant.pose[0], rel=1e-6)
    assert farthest(task) == pytest.approx(17.85)
    varying = replace(disturbed, plant=replace(line, wheel_slip_stddev=0.1))
    assert farthest(varying) == math.inf


def test_an_outcome_reads_back_bit_for_bit(task):
    made = outcome(drive(task))
    assert StudyOutcome.from_values(json.loads(made.to_json())) == made
    nan = replace(made, miss=math.nan, road_clearance=math.nan)
    assert nan.verdict(1e-3) == RunVerdict.LEFT_ROAD


def test_noise_repeats_and_differs_from_run_to_run():
    study = Study('disturbed', 2)
    first, again, other = (drive(study.run(number)) for number in (4, 4, 5))
    assert outcome(first) == outcome(again)
    assert not np.array_equal(first.decisions[0].twist, other.decisions[0].twist)


def test_a_computer_that_is_late_touches_nothing_and_its_late_commands_are_not_sent():
    study, late, arrived = Study('realtime'), 0, 0
    for number in range(6):
        driven = drive(study.run(number))
        made = outcome(driven)
        assert made.clearance >= 0.0, number
        assert made.exception == ''
        late += sum(each.late > 0.2 for each in driven.decisions)
        arrived += made.miss < study.tolerance
    assert late > 18
    assert arrived > 1


@pytest.mark.parametrize('number', [1, 10])
def test_a_robot_whose_delay_is_told_wrong_arrives(number):
    """Without correction it touches an obstacle or leaves the road."""
    study = Study('told_wrong')
    made = outcome(drive(study.run(number)))
    assert made.verdict(study.tolerance) is RunVerdict.ARRIVED
    assert made.clearance > 0.02
    assert abs(made.told_error) > 0.03
    believing = Study('told_wrong', assignments=('command_delay_tolerance=0.0',))
    assert outcome(drive(believing.run(number))).clearance < 0.0


def test_a_foreign_robot_is_the_same_each_time_and_another_in_each_run():
    study = Study('told_wrong')
    one, same, other = (drive(study.run(number)) for number in (2, 2, 3))
    assert outcome(one) == outcome(same)
    assert one.task.foreign == same.task.foreign != other.task.foreign
    poses = np.array([each.pose for each in one.motions])
    assert np.array_equal(poses, np.array([each.pose for each in same.motions]))
