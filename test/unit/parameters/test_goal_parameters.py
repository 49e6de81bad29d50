"""Goals and roads without end as parameters: what is taken, and what is refused."""

import math

import pytest

from cmpsp_ros.guidance import Follow, Goal
from cmpsp_ros.parameters import TABLE, ParameterError, check_simulation, guidance_settings

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


FOLLOWED = {'follow.speed': 1.0}


@pytest.mark.parametrize(
    ('given', 'changes', 'said'),
    [
        (WAYPOINTS, {'waypoints.a.position': [7.0, -4.0]},
         'waypoints.a.position: found 0.938 m inside or beyond the inner road edge'),
        (WAYPOINTS, {'waypoints.a.time': 0.1},
         'waypoints.a.time: found 0.1 s, wanted 0 + control_period'),
        (WAYPOINTS, {'waypoints.b.time': 4.1},
         'waypoints.b.time: found 4.1 s, wanted waypoints.a.time +'),
        (WAYPOINTS, {'final_time': 8.0},
         'final_time: found 8.0 s, wanted waypoints.b.time + control_period'),
        (WAYPOINTS, {'goal.heading': [1.0, 2.0]},
         'goal.heading: found [1.0, 2.0], wanted a list of one'),
        (WAYPOINTS, {'goal.nominal_speed': 2.0},
         'goal.nominal_speed: found 2.0 m/s, wanted at most'),
        (WAYPOINTS, {'final_time': 0.0}, 'final_time: found 0.0 s'),
        (WAYPOINTS, FOLLOWED, "waypoints.names: found ['a', 'b'], wanted none"),
        ({}, {'follow.speed': 1.8}, 'follow.speed: found 1.8 m/s, wanted at most'),
        (FOLLOWED, {'follow.horizon': 0.3}, 'follow.horizon: found 0.3 s, wanted 2 to 1000 times'),
        (FOLLOWED, {'follow.horizon': 40.0},
         'follow.horizon: found 40 m of way within it, wanted less than'),
        (FOLLOWED, {'road.type': 'none'},
         'follow.speed: found 1.0 m/s, wanted 0 on a road with an end'),
        (FOLLOWED, {'road.type': 'corridor', 'road.points': [0.0, 0.0, 9.0, 0.0]},
         'follow.speed: found 1.0 m/s, wanted 0 on a road with an end'),
    ],
)  # fmt: skip
def test_what_cannot_be_driven_is_refused(given, changes, said):
    with pytest.raises(ParameterError) as caught:
        guidance_settings(TABLE.resolve(given | changes))
    assert said in str(caught.value)


def test_waypoints_are_between_control_periods_in_lockstep_nowhere():
    values = TABLE.resolve(WAYPOINTS | {'waypoints.a.time': 4.1, 'lockstep': True})
    with pytest.raises(
        ParameterError, match=r'waypoints\.a\.time: found 4\.1 s, wanted a multiple'
    ):
        check_simulation(values)


def test_a_road_without_end():
    settings = guidance_settings(TABLE.resolve({'follow.speed': -1.0, 'final_time': 0.0}))
    assert settings.follow == Follow(-1.0, 5.0)
    assert settings.goals == ()
    assert settings.final_time == math.inf
