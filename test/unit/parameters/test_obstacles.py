"""Obstacles that stand still, as the parameters describe them."""

import pytest

from cmpsp_ros.parameters import TABLE, ParameterError, check_simulation, guidance_settings
from cmpsp_ros.parameters.obstacles import obstacles_of
from cmpsp_ros.world.obstacles import Capsule, Obstacle
from cmpsp_ros.world.obstacles.shapes import Polygon

SQUARE = [9.5, -3.0, 10.5, -3.0, 10.5, -2.0, 9.5, -2.0]


def given(kind, **block):
    values = {f'obstacles.a.{key}': value for key, value in block.items()}
    return TABLE.resolve({'obstacles.names': ['a'], 'obstacles.a.type': kind, **values})


def refusal(values):
    with pytest.raises(ParameterError) as caught:
        guidance_settings(values)
    with pytest.raises(ParameterError):
        check_simulation(values)
    return [str(each) for each in caught.value.problems]


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


@pytest.mark.parametrize(
    ('values', 'wanted'),
    [
        (
            given('circle'),
            [
                'obstacles.a.center: found nothing, wanted a list of 2 numbers [m]',
                'obstacles.a.radius: found nothing, or 0, wanted a number > 0 [m]',
            ],
        ),
        (
            given('circle', center=[8, -6], radius=0.7, end=[1, 2]),
            ['obstacles.a.end: found [1.0, 2.0], wanted nothing with type circle'],
        ),
        (
            given('capsule', start=[8, -6], end=[9], radius=0.1),
            ['obstacles.a.end: found [9.0], wanted a list of 2 numbers [m]'],
        ),
        (
            given('polygon', vertices=SQUARE[:5]),
            [
                'obstacles.a.vertices: found [9.5, -3.0, 10.5, -3.0, 10.5], wanted x and y [m] of'
                ' each vertex'
            ],
        ),
        (
            given('polygon', vertices=SQUARE, radius=0.1),
            ['obstacles.a.radius: found 0.1, wanted nothing with type polygon'],
        ),
        (
            given('polygon', vertices=[*SQUARE, 9.9, -2.5]),
            [
                'obstacles.a.vertices: found at vertex 4 (from 0) a corner that is not convex,'
                ' wanted a turn to the same side as others'
            ],
        ),
    ],
)
def test_what_is_refused(values, wanted):
    assert refusal(values) == wanted


def test_no_goal_and_no_start_in_a_polygon():
    values = given('polygon', vertices=[9.5, -0.5, 10.5, -0.5, 10.5, 0.5, 9.5, 0.5])
    with pytest.raises(ParameterError) as caught:
        guidance_settings(values)
    assert str(caught.value) == (
        'goal.position: found 0.5 m inside or beyond obstacle a, wanted a place where robot.radius'
        ' is clear'
    )
