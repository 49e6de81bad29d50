"""Poses in other frames, by messages of `/tf` as another program would have written them."""

import math

import numpy as np
import pytest

from cmpsp_ros.bags.definitions import jazzy
from cmpsp_ros.guidance.messages import TransformError, Transforms, compose

SECOND = 1_000_000_000
TF = 'tf2_msgs/msg/TFMessage'


def message(stamp, parent, child, x, y, heading, tilt=0.0):
    """It has been through CDR, as on the wire; a frame is tilted about its own x axis."""
    types = jazzy().types
    header = types['std_msgs/msg/Header'](
        types['builtin_interfaces/msg/Time'](*divmod(stamp, SECOND)), parent
    )
    transform = types['geometry_msgs/msg/Transform'](
        types['geometry_msgs/msg/Vector3'](x, y, 0.3),
        types['geometry_msgs/msg/Quaternion'](
            math.cos(heading / 2.0) * math.sin(tilt / 2.0),
            math.sin(heading / 2.0) * math.sin(tilt / 2.0),
            math.sin(heading / 2.0) * math.cos(tilt / 2.0),
            math.cos(heading / 2.0) * math.cos(tilt / 2.0),
        ),
    )
    stamped = types['geometry_msgs/msg/TransformStamped'](header, child, transform)
    return jazzy().deserialize_cdr(jazzy().serialize_cdr(types[TF]([stamped]), TF), TF)


@pytest.fixture
def transforms():
    """A robot in `odom`, which drifts in `map`, and a scanner upon it."""
    known = Transforms()
    for second, (x, y, heading) in enumerate([(1.0, 2.0, 3.1), (2.0, 4.0, -3.1)]):
        known.add(message(10 * SECOND + second * SECOND, 'map', 'odom', x, y, heading))
    known.add(message(10 * SECOND, 'odom', 'base_link', 5.0, 0.0, math.pi / 2.0))
    known.add(message(0, 'base_link', 'scanner', 0.2, 0.0, math.pi), is_static=True)
    return known


def test_between_two_instants_it_is_interpolated_the_shorter_way_round(transforms):
    x, y, heading = transforms.look_up('map', 'odom', 10 * SECOND + SECOND // 2, 0.5)
    assert (x, y) == pytest.approx((1.5, 3.0))
    assert math.cos(heading) == pytest.approx(-1.0, abs=1e-3)


def test_a_chain_is_followed_there_and_back(transforms):
    there = transforms.look_up('map', 'scanner', 10 * SECOND, 0.5)
    back = transforms.look_up('scanner', 'map', 10 * SECOND, 0.5)
    np.testing.assert_allclose(compose(there, back), np.zeros(3), atol=1e-12)
    np.testing.assert_allclose(compose(back, there), np.zeros(3), atol=1e-12)
    in_odom = transforms.look_up('odom', 'scanner', 10 * SECOND, 0.5)
    np.testing.assert_allclose(in_odom, (5.0, 0.2, -math.pi / 2.0), atol=1e-12)
    by_hand = compose(np.array([1.0, 2.0, 3.1]), in_odom)
    np.testing.assert_allclose(there, by_hand, atol=1e-12)
    siblings = transforms.look_up('scanner', 'base_link', 99 * SECOND, 100.0)
    np.testing.assert_allclose(compose(siblings, siblings), np.zeros(3), atol=1e-12)
    np.testing.assert_allclose(siblings[:2], (0.2, 0.0), atol=1e-12)


def test_the_last_one_holds_for_a_while_and_a_static_one_for_ever(transforms):
    late = transforms.look_up('map', 'odom', 11 * SECOND + SECOND // 4, 0.5)
    np.testing.assert_allclose(late, (2.0, 4.0, -3.1), atol=1e-12)
    with pytest.raises(TransformError, match=r"'odom' to 'map' is 0\.750 s off"):
        transforms.look_up('map', 'odom', 11 * SECOND + 3 * SECOND // 4, 0.5)
    transforms.look_up('base_link', 'scanner', 10**6 * SECOND, 0.5)


def test_time_that_has_jumped_back_has_what_came_later_forgotten(transforms):
    transforms.add(message(2 * SECOND, 'map', 'odom', 7.0, 0.0, 0.0))
    np.testing.assert_allclose(
        transforms.look_up('map', 'odom', 2 * SECOND, 0.5), (7.0, 0.0, 0.0), atol=1e-12
    )
    with pytest.raises(TransformError, match='off'):
        transforms.look_up('map', 'odom', 11 * SECOND, 0.5)


@pytest.mark.parametrize('is_known', [False, True], ids=['before', 'after'])
def test_after_time_has_jumped_back_nothing_of_the_run_before_is_known(transforms, is_known):
    """Not even of before that time, be the first transform of the new run known or not."""
    if is_known:
        transforms.add(message(10 * SECOND + SECOND // 4, 'map', 'odom', 7.0, 0.0, 0.0))
    transforms.forget_after(10 * SECOND + SECOND // 5)
    if is_known:
        there = transforms.look_up('map', 'odom', 10 * SECOND + SECOND // 5, 0.5)
        np.testing.assert_allclose(there, (7.0, 0.0, 0.0), atol=1e-12)
    else:
        with pytest.raises(TransformError, match=r"no transform from 'odom' to 'map'"):
            transforms.look_up('map', 'odom', 10 * SECOND + SECOND // 5, 0.5)
    transforms.look_up('base_link', 'scanner', 10 * SECOND, 0.5)


@pytest.mark.parametrize('late', [0.0, 0.02, 0.1, 0.3])
def test_a_motion_is_as_fast_when_the_last_transform_is_late(late):
    known, speed, rate = Transforms(), 1.5, -0.4
    known.add(message(0, 'base_link', 'radar', 0.2, 0.0, 0.0), is_static=True)
    for k in range(20):
        time = 10.0 - late - 0.05 * (19 - k)
        stamp, heading = round(time * SECOND), rate * (time - 10.0)
        known.add(message(stamp, 'odom', 'base_link', speed * time, 0.0, heading))
    there, motion = known.motion('odom', 'radar', 10 * SECOND, 0.5)
    assert motion == pytest.approx([speed, 0.2 * rate, rate], abs=0.02)
    assert there == pytest.approx([10.0 * speed + 0.2, 0.0, 0.0], abs=0.01)
    with pytest.raises(TransformError, match='off'):
        known.motion('odom', 'radar', 11 * SECOND, 0.5)


def test_a_motion_that_is_not_known_yet_is_not_taken_for_rest():
    known = Transforms()
    for stamp in (9_950_000_000, 10 * SECOND):
        known.add(message(stamp, 'odom', 'radar', stamp / SECOND, 0.0, 0.0))
    with pytest.raises(TransformError, match=r"'radar' is known in 'odom' for too short a time"):
        known.motion('odom', 'radar', 10 * SECOND, 0.5)


@pytest.mark.parametrize('tilt', [0.3, -0.3, 0.4, math.pi / 2.0, math.pi])
def test_a_frame_whose_z_axis_does_not_point_up_is_refused(tilt):
    known = Transforms()
    known.add(message(SECOND, 'base_link', 'camera', 0.2, 0.0, 0.7, tilt))
    if abs(tilt) == 0.3:
        there = known.look_up('base_link', 'camera', SECOND, 0.5)
        assert there == pytest.approx([0.2, 0.0, 0.7])
    else:
        said = rf"'camera' is tilted by {math.degrees(tilt):.0f} deg in 'base_link'"
        with pytest.raises(TransformError, match=said):
            known.look_up('base_link', 'camera', SECOND, 0.5)


def test_a_stamp_of_zero_asks_for_the_latest(transforms):
    np.testing.assert_allclose(
        transforms.look_up('map', 'odom', 0, 0.5), (2.0, 4.0, -3.1), atol=1e-12
    )


@pytest.mark.parametrize(('target', 'source'), [('world', 'odom'), ('map', 'nowhere')])
def test_what_is_not_known_is_said(transforms, target, source):
    with pytest.raises(TransformError, match=f"no transform from '{source}' to '{target}'"):
        transforms.look_up(target, source, 10 * SECOND, 0.5)


def test_a_circle_and_numbers_that_are_none_are_no_transforms(transforms):
    transforms.add(message(12 * SECOND, 'map', 'odom', math.nan, 0.0, 0.0))
    np.testing.assert_allclose(
        transforms.look_up('map', 'odom', 11 * SECOND, 0.5), (2.0, 4.0, -3.1), atol=1e-12
    )
    transforms.add(message(10 * SECOND, 'scanner', 'map', 0.0, 0.0, 0.0))
    with pytest.raises(TransformError, match='in a circle'):
        transforms.look_up('map', 'odom', 10 * SECOND, 0.5)
