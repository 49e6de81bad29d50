"""A run begins near the road, or near the start that was given."""

import numpy as np
import pytest

from cmpsp_ros.guidance.mission import reason_not_to_begin
from cmpsp_ros.parameters import TABLE, ParameterError, guidance_settings, load_parameter_file
from cmpsp_ros.parameters.files import preset_names

ORIGIN = np.zeros(3)


def settings(preset='case3', **changes):
    given = {key.replace('_of_', '.'): value for key, value in changes.items()}
    return guidance_settings(TABLE.resolve({**load_parameter_file(preset), **given}))


@pytest.mark.parametrize('name', preset_names())
def test_every_preset_may_begin_where_its_robot_is(name):
    values = TABLE.resolve(load_parameter_file(name))
    assert not reason_not_to_begin(settings(name), np.array(values['initial_pose']))


def test_odometry_that_begins_at_the_origin_with_a_course_elsewhere():
    assert reason_not_to_begin(settings(), ORIGIN) == (
        'The robot is 9 m off the road, more than 0.5 m (start.tolerance): no run begins there.'
    )


@pytest.mark.parametrize(('y', 'begins'), [(-11.49, True), (-11.51, False), (-8.51, True)])
def test_beside_the_road_the_tolerance_counts(y, begins):
    assert (not reason_not_to_begin(settings(), np.array([0.0, y, 0.0]))) == begins


def test_a_corridor_has_ends_too():
    road = settings('corridor').road
    (first, second) = np.array(road.points[:2])
    before = first - 0.7 * (second - first) / np.linalg.norm(second - first)
    pose = np.array([*before, 0.0])
    assert ' m off the road, more than 0.5 m' in reason_not_to_begin(settings('corridor'), pose)
    assert not reason_not_to_begin(settings('corridor', start_of_tolerance=1.0), pose)


def test_open_floor_is_everywhere():
    assert not reason_not_to_begin(settings('floor'), np.array([1e3, 1e3, 0.0]))


def test_a_start_that_is_given_counts_instead_of_the_road():
    given = settings(start_of_pose=[0.0, -9.25, 0.0])
    assert not reason_not_to_begin(given, np.array([0.3, -9.25, 2.0]))
    assert reason_not_to_begin(given, np.array([3.0, -9.25, 0.0])) == (
        'The robot is 3 m from start.pose, more than 0.5 m (start.tolerance): no run begins there.'
    )
    with pytest.raises(ParameterError, match=r'start\.pose'):
        settings(start_of_pose=[0.0, 1.0])
