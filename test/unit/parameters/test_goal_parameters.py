"""Goals and roads without end as parameters."""

import math

from cmpsp_ros.guidance import Follow, Goal
from cmpsp_ros.parameters import TABLE, guidance_settings

WAYPOINTS = {
    'waypoints.names': ['a', 'b'],
    'waypoints.a.position': [7.0, -7.0], 'waypoints.a.time': 4.0,
    'waypoints.b.position': [9.5, -3.0], 'waypoints.b.time': 8.0, 'waypoints.b.heading': [1.2],
}  # fmt: skip


def test_goals_in_their_order():
    settings = guidance_settings(TABLE.resolve(WAYPOINTS | {'goal.heading': [1.6]}))
    assert settings.goals == (
        Goal((7.0, -7.0), 4.0, None, 'a'),
        Goal((9.5, -3.0), 8.0, 1.2, 'b'),
        Goal((10.0, 0.0), 10.0, 1.6, 'goal'),
    )
    assert guidance_settings(TABLE.resolve({})).goals == (Goal((10.0, 0.0), 10.0),)


def test_one_leg_has_one_goal_and_its_own_time():
    settings = guidance_settings(TABLE.resolve(WAYPOINTS))
    leg = settings.towards(settings.goals[1], 4.0)
    assert leg.goals == (Goal((9.5, -3.0), 4.0, 1.2),)


def test_a_road_without_end():
    settings = guidance_settings(TABLE.resolve({'follow.speed': -1.0, 'final_time': 0.0}))
    assert settings.follow == Follow(-1.0, 5.0)
    assert settings.goals == ()
    assert settings.final_time == math.inf
