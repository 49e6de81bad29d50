"""Roads from parameters."""

import math

import pytest

from cmpsp_ros.parameters import TABLE, ParameterError, guidance_settings, road_keys
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
