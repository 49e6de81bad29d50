"""Rooms and fields of the studies in which nothing moves, seen by a scanner that drives."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scanned_rooms import Faults, ScannedRoom

from cmpsp_ros.simulator import discs_of, edges_of
from cmpsp_ros.studies.monte_carlo.courses.rooms import SPARE, field_scenario, room_scenario
from cmpsp_ros.studies.monte_carlo.guesses import grid_path
from cmpsp_ros.studies.monte_carlo.study import Study

FAULTS = Faults(missed=0.3, odometry=(0.005, math.radians(0.5)))


def to_and_fro(path, speed=1.0):
    """Robot that drives a path, and looks to both sides."""
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])

    def place(time):
        driven = speed * time % (2.0 * along[-1])
        driven = min(driven, 2.0 * along[-1] - driven)
        return np.array([np.interp(driven, along, each) for each in path.T])

    def robot(time):
        before, after = place(max(time - 0.6, 0.0)), place(time + 0.6)
        heading = math.atan2(after[1] - before[1], after[0] - before[0])
        return (*place(time).tolist(), heading + 0.3 * math.sin(1.5 * time))

    return robot


def tracks_in(study, draw, number, until):
    settings, _ = Study(study).setup()
    scenario = draw(settings, 7, number, 0)
    given = replace(settings, obstacles=scenario.obstacles, goal=scenario.changes['goal'])
    path = grid_path(given, np.array(scenario.pose), SPARE)[:, :2]
    posts = [(x, y, radius) for x, y, *_, radius in discs_of(scenario.obstacles).tolist()]
    edges = edges_of(scenario.obstacles)
    room = ScannedRoom(edges, posts, robot=to_and_fro(path), faults=FAULTS, reach=8.0)
    return {each.id for _, sighting in room.run(until) for each in sighting.tracks}


@pytest.mark.parametrize(
    ('study', 'draw'),
    [('sight', room_scenario), ('clutter', field_scenario)],
    ids=('rooms', 'fields'),
)
def test_a_room_in_which_all_stands_has_no_track(study, draw):
    assert not tracks_in(study, draw, 0, 10.0)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_there_is_at_most_one_track_a_minute_in_a_hundred_rooms():
    found = [
        len(tracks_in(study, draw, number, 60.0))
        for number in range(50)
        for study, draw in (('sight', room_scenario), ('clutter', field_scenario))
    ]
    print(f'{sum(found)} tracks in {len(found)} minutes')
    assert max(found) <= 1
