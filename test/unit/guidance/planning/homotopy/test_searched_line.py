"""Lines searched on a grid of limited cells, however far away the goal is."""

import math

import numpy as np
import pytest

from cmpsp_ros.guidance import GuidanceLaw, Observation
from cmpsp_ros.guidance.planning.homotopy.path_search import searched_line
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import Obstacle
from cmpsp_ros.world.roads import OpenFloor


@pytest.mark.parametrize('distance', [10.0, 310.0, 400.0, 5e3, 1e6])
@pytest.mark.parametrize('angle', [0.0, 0.5, 2.0, -1.5])
def test_a_line_leads_from_start_to_goal_at_any_distance(distance, angle):
    space = FreeSpace.of(OpenFloor(), (Obstacle('a', (0.5, 0.3), 0.2),), 0.1)
    goal = distance * np.array([math.cos(angle), math.sin(angle)])
    line = searched_line(space, np.zeros(2), goal)
    assert (line[[0, -1]] == [np.zeros(2), goal]).all()
    length = np.hypot(*np.diff(line, axis=0).T).sum()
    assert distance <= length * (1.0 + 1e-9)
    assert length < 1.15 * distance


@pytest.mark.parametrize('distance', [400.0, -5e3])
def test_the_law_drives_towards_a_goal_that_no_time_is_enough_for(distance):
    values = {**load_parameter_file('floor'), 'goal.position': [distance, distance / 3.0]}
    settings = guidance_settings(TABLE.resolve(values))
    law, pose = GuidanceLaw(settings, settings.world), np.zeros(3)
    decision = law.step(Observation(0, pose))
    law.after_step()
    assert 'final_time would have to be' in law.warnings[0]
    assert decision.plan is not None
    assert math.dist(decision.plan.poses[-1][:2], settings.goal) < abs(distance) * math.hypot(
        1, 1 / 3
    )
