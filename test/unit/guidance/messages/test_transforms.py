"""Poses in other frames, by messages of `/tf` as another program would have written them."""

import math

import numpy as np
import pytest

from cmpsp_ros.bags.definitions import jazzy
from cmpsp_ros.guidance.messages import TransformError, Transforms, compose

SECOND = 1_000_000_000
TF = 'tf2_msgs/msg/TFMessage'


def message(stamp, parent, child, x, y, heading):
    """It has been through CDR, as on the wire."""
    types = jazzy().types
    header = types['std_msgs/msg/Header'](
        types['builtin_interfaces/msg/Time'](*divmod(stamp, SECOND)), parent
    )
    transform = types['geometry_msgs/msg/Transform'](
        types['geometry_msgs/msg/Vector3'](x, y, 0.3),
        types['geometry_msgs/msg/Quaternion'](
            0.0, 0.0, math.sin(heading / 2.0), math.cos(heading / 2.0)
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
