"""Obstacles that stand still, as the parameters describe them."""

import pytest

from cmpsp_ros.parameters import TABLE, check_simulation, guidance_settings, shapes_of
from cmpsp_ros.parameters.obstacles import obstacles_of
from cmpsp_ros.world.obstacles import Capsule, Obstacle
from cmpsp_ros.world.obstacles.shapes import Polygon

SQUARE = [9.5, -3.0, 10.5, -3.0, 10.5, -2.0, 9.5, -2.0]


def given(kind, **block):
    values = {f'obstacles.a.{key}': value for key, value in block.items()}
    return TABLE.resolve({'obstacles.names': ['a'], 'obstacles.a.type': kind, **values})


@pytest.mark.parametrize(
    ('values', 'wanted'),
    [
        (given('circle', center=[8, -6], radius=0.7), Obstacle('a', (8.0, -6.0), 0.7)),
        (
            given('capsule', start=[8, -6], end=[9, -5], radius=0.1),
            Capsule('a', (8.0, -6.0), (9.0, -5.0), 0.1),
        ),
        (
            given('polygon', vertices=SQUARE),
            Polygon('a', ((9.5, -3.0), (10.5, -3.0), (10.5, -2.0), (9.5, -2.0))),
        ),
    ],
)
def test_every_type(values, wanted):
    assert obstacles_of(values) == (wanted,)
    assert guidance_settings(values).obstacles == (wanted,)
    check_simulation(values)


def test_obstacles_of_the_simulator_are_no_others():
    block = {'type': 'capsule', 'start': [0, 0], 'end': [1, 0], 'radius': 0.1}
    values = TABLE.resolve(
        {
            'sim.obstacles.names': ['wall'],
            **{f'sim.obstacles.wall.{k}': v for k, v in block.items()},
        }
    )
    assert shapes_of(values) == (Capsule('wall', (0.0, 0.0), (1.0, 0.0), 0.1),)
    assert obstacles_of(values) == ()
