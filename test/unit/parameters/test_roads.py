"""Roads from parameters."""

import math

import pytest

from cmpsp_ros.parameters import (
    TABLE,
    ParameterError,
    check_simulation,
    guidance_settings,
    road_keys,
)
from cmpsp_ros.parameters.roads import road_of
from cmpsp_ros.world.roads import Annulus, Corridor, OpenFloor

BEND = {'road.type': 'corridor', 'road.points': [0.0, 0.0, 3.0, 0.0, 6.0, 1.0, 8.0, 3.0]}
GOAL = {'goal.position': [6.0, 1.0], 'initial_pose': [0.5, 0.0, 0.0]}


def values(**changes):
    return TABLE.resolve(BEND | GOAL | {k.replace('__', '.'): v for k, v in changes.items()})


def test_each_type_makes_its_road():
    assert road_of(TABLE.resolve({})) == Annulus()
    assert road_of(values(road__type='none')) == OpenFloor()
    road = road_of(values(road__half_width=[0.5], road__left_width=[0.4, 0.5, 0.6, 0.7]))
    points = ((0.0, 0.0), (3.0, 0.0), (6.0, 1.0), (8.0, 3.0))
    assert road == Corridor(points, (0.4, 0.5, 0.6, 0.7), (0.5,) * 4, closed=False)
    for given in (TABLE.resolve({}), values(), values(road__type='none')):
        assert set(road_keys(given)) <= set(given)


@pytest.mark.parametrize(
    ('changes', 'said'),
    [
        ({'road__points': []}, 'road.points: found .*, wanted x and y of each point'),
        ({'road__points': [0.0, 0.0, 1.0]}, 'road.points: found .*, wanted x and y of each point'),
        ({'road__points': [0.0, 0.0]}, 'at point 1 .*, wanted 2 points or more'),
        ({'road__points': [0.0, 0.0, 0.0, 0.0]}, r'at point 1 \(from 0\) the same place'),
        ({'road__points': [0.0, 0.0, 3.0, 0.0, 1.0, 0.0]}, 'at point 1 .* turn back by 180 deg'),
        ({'road__half_width': [0.5, 0.5]}, 'road.half_width: found 2 widths, wanted one, or one'),
        ({'road__right_width': [0.5, 0.5]}, 'road.right_width: found 2 widths, wanted one, or one'),
        ({'road__half_width': [0.5, 0.0, 0.5, 0.5]}, 'road.half_width: found .* numbers > 0'),
        ({'road__half_width': [9.0]}, 'point .* a curve of radius .* m after it'),
        (
            {'road__half_width': [0.5, 0.2, 0.5, 0.5], 'robot__radius': 0.2},
            'found 0.2 m to the left of point 1, wanted more than robot.radius',
        ),
        (
            {'goal__position': [3.0, 1.5]},
            'goal.position: found .* m inside or beyond the left road edge, wanted a place where',
        ),
        ({'goal__position': [8.5, 3.5]}, r'goal.position: found .* beyond the end of the road'),
    ],
)
def test_what_cannot_be_driven_is_refused(changes, said):
    with pytest.raises(ParameterError, match=said):
        guidance_settings(values(**changes))


def test_a_start_off_the_road_is_refused():
    check_simulation(values())
    with pytest.raises(ParameterError, match=r'initial_pose: found .* beyond the right road edge'):
        check_simulation(values(initial_pose=[1.0, -1.2, 0.0]))
    with pytest.raises(ParameterError, match=r'initial_pose: found 0.499\d* m beyond the end'):
        check_simulation(values(initial_pose=[-0.5, 0.0, 0.0]))


def test_open_floor_refuses_no_place_but_an_obstacle():
    obstacle = {'obstacles.names': ['a'], 'obstacles.a.center': [1.0, 0.0]}
    given = TABLE.resolve({'road.type': 'none', 'obstacles.a.radius': 0.5, **obstacle})
    assert guidance_settings(given).road == OpenFloor()
    guidance_settings(given | {'goal.position': [1e3, -1e3]})
    with pytest.raises(ParameterError, match='obstacle a'):
        guidance_settings(given | {'goal.position': [1.2, 0.0]})


def test_only_an_annulus_is_one():
    assert guidance_settings(TABLE.resolve({})).world.annulus == Annulus()
    with pytest.raises(ValueError, match=r'road\.type: found corridor, wanted annulus'):
        assert guidance_settings(values()).world.annulus
    assert math.isclose(road_of(values()).width, 2.0)
