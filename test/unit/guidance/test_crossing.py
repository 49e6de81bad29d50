"""On a road that crosses itself the robot stays on its branch, whichever way it turns."""

import math

import numpy as np
import pytest

from cmpsp_ros.guidance import GuidanceLaw, Observation
from cmpsp_ros.guidance.messages import Track
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file
from cmpsp_ros.world.roads import Annulus, project_on_path

PERIOD = 200_000_000
STEPS = 300
# With one plan it gives way so far that its heading is that of the other branch.
VALUES = TABLE.resolve(load_parameter_file('course') | {'solver.candidates': 1})
SETTINGS = guidance_settings(VALUES)
ROAD = SETTINGS.road


def tracks(stamp):
    """Moving obstacles, as the simulator publishes them."""
    seconds, found = stamp / 1e9, []
    for number, name in enumerate(VALUES['moving_obstacles.names']):
        block = f'moving_obstacles.{name}'
        center, velocity = (np.array(VALUES[f'{block}.{key}']) for key in ('center', 'velocity'))
        place = (center + seconds * velocity).tolist()
        radius = VALUES[f'{block}.radius']
        found.append(Track(number, stamp, radius, *place, *velocity.tolist()))
    return tuple(found)


def test_a_robot_that_gives_way_at_the_crossing_keeps_to_its_branch():
    law, pose, poses, decisions = (
        GuidanceLaw(SETTINGS, SETTINGS.world),
        np.array(VALUES['initial_pose']),
        [],
        [],
    )
    for step in range(STEPS):
        decisions.append(law.step(Observation(step * PERIOD, pose, tracks(step * PERIOD))))
        poses.append(pose)
        held = decisions[-1].wheel_speeds[None]
        pose = SETTINGS.robot.roll_out(pose, held, np.array([0.2]))[-1]
    assert {each.level.name for each in decisions} == {'NOMINAL'}
    assert math.dist(pose[:2], SETTINGS.goal) < 1e-6
    # By its heading alone it was on the other branch for a moment.
    before, carried, afresh = math.nan, [], []
    for each in poses:
        before = project_on_path(ROAD, each, before)
        carried.append(before)
        afresh.append(project_on_path(ROAD, each, math.nan))
    apart = np.subtract(carried, afresh)
    assert np.abs(apart - ROAD.length * np.round(apart / ROAD.length)).max() > 1.0
    steps = np.diff(np.unwrap(carried, period=ROAD.length))
    assert np.abs(steps).max() < SETTINGS.robot.max_speed * 0.2 + 0.1


def test_a_robot_that_was_moved_is_found_afresh():
    crossing, beside = np.array([0.0, 0.0, 0.0]), np.array([10.0, 0.0, 1.571])
    one, other = (
        project_on_path(ROAD, crossing + np.array([0.0, 0.0, turn]), math.nan)
        for turn in (0.8, -0.8)
    )
    assert abs(math.remainder(one - other, ROAD.length)) > 10.0
    # Here it stays where it was, whatever its heading.
    for was in (one, other):
        for turn in np.linspace(-math.pi, math.pi, 9):
            found = project_on_path(ROAD, crossing + np.array([0.05, 0.02, turn]), was)
            assert math.remainder(found - was, ROAD.length) == pytest.approx(0.0, abs=0.1)
    # There it cannot have come from here.
    wanted = project_on_path(ROAD, beside, math.nan)
    for was in (one, other):
        assert project_on_path(ROAD, beside, was) == pytest.approx(wanted)


def test_other_roads_need_no_place():
    assert math.isnan(project_on_path(Annulus(), np.array([0.0, -9.25, 0.0]), 3.0))
