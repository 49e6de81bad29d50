"""Footprints from parameters."""

import math

import pytest

from cmpsp_ros.parameters import (
    TABLE,
    ParameterError,
    check_simulation,
    guidance_settings,
    load_parameter_file,
    plausibility_warnings,
)

BOX = '[[-0.2, -0.15], [0.1, -0.15], [0.1, 0.15], [-0.2, 0.15]]'


def values(preset=None, **changes):
    given = {'road.type': 'none'} if preset is None else load_parameter_file(preset)
    return TABLE.resolve(given | {key.replace('__', '.'): each for key, each in changes.items()})


def test_a_footprint_counts_instead_of_the_radius():
    given = values(robot__footprint=BOX, robot__radius=3.0)
    settings = guidance_settings(given)
    assert settings.footprint.corners[0] == (-0.2, -0.15)
    assert settings.robot_radius == pytest.approx(math.hypot(0.15, 0.075), rel=1e-8)
    assert settings.inscribed_radius == pytest.approx(0.1)
    assert 'robot.radius does not count' in ' '.join(plausibility_warnings(given))
    assert not list(plausibility_warnings(values(robot__footprint=BOX)))


def test_without_one_the_robot_is_a_disc():
    settings = guidance_settings(values(robot__radius=0.2))
    assert settings.footprint.centers == ((0.0, 0.0),)
    assert settings.robot_radius == settings.inscribed_radius == 0.2


@pytest.mark.parametrize(
    'text',
    [
        BOX.replace(' ', ''),
        '[[-.2, -.15], [+.1, -15e-2], [1e-1, .15], [-.2, .15]]',
        '[[-1, -1], [1, -1], [0, 1]]',
        '[[-0.2, 0.15], [0.1, 0.15], [0.1, -0.15], [-0.2, -0.15]]',
        '[[-1, -1], [0.5, -0.1], [2, -1], [0, 1]]',
        '[[-1, -1], [0, -1], [1, -1], [0, 1]]',
    ],
    ids=['tight', 'floats', 'integers', 'clockwise', 'not convex', 'corner on a side'],
)
def test_what_can_be_read(text):
    given = values(robot__footprint=text)
    assert len(guidance_settings(given).footprint.corners) == text.count('[') - 1


def test_millimetres():
    given = values(robot__footprint=BOX.replace('0.', '100.'))
    assert 'robot.footprint looks like millimetres' in ' '.join(plausibility_warnings(given))


def test_a_long_robot_may_begin_along_a_wall_and_not_across():
    """The wall is 0.3 m to the left of it."""
    given = {
        'robot__footprint': '[[-0.2, -0.2], [1.0, -0.2], [1.0, 0.2], [-0.2, 0.2]]',
        'obstacles__names': ['wall'],
        'obstacles.wall.type': 'polygon',
        'obstacles.wall.vertices': [-3.0, 0.3, 3.0, 0.3, 3.0, 0.5, -3.0, 0.5],
        'goal__position': [2.0, 0.0],
        'goal__heading': [0.0],
        'initial_pose': [0.0, 0.0, 0.0],
    }
    check_simulation(values(**given))
    guidance_settings(values(**given))
    turned = values(**given | {'initial_pose': [0.0, 0.0, 0.5], 'goal__heading': [0.5]})
    with pytest.raises(
        ParameterError, match=r'initial_pose: found .* inside or beyond obstacle wall'
    ):
        check_simulation(turned)
    with pytest.raises(ParameterError, match=r'goal\.position: found .* beyond obstacle wall'):
        guidance_settings(turned)
    # Where the heading is free some may do.
    guidance_settings(values(**given | {'goal__heading': []}))
    with pytest.raises(ParameterError, match=r'goal\.position'):
        guidance_settings(values(**given | {'goal__heading': [], 'goal__position': [2.0, 0.15]}))
