"""Exact distances of arcs from points, against dense sampling."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from cmpsp_ros.robots.motion import arc_from, reach_of

SAMPLES = 4001
unhurried = hypothesis_settings(deadline=None, max_examples=150)
places = st.floats(-3.0, 3.0)


def reach(pose, twist, duration, points):
    """Least and greatest distance of an arc from each point."""
    arc = arc_from(*map(float, pose), float(twist[0] * duration), float(twist[1] * duration))
    found = [reach_of(arc, float(x), float(y)) for x, y in points]
    return np.array(found).reshape(-1, 2).T


def sampled(pose, twist, duration, points):
    """Least and greatest distance over points of the arc, sample by sample."""
    speed, turn_rate = twist
    times = np.linspace(0.0, duration, SAMPLES)
    middle = pose[2] + turn_rate * times / 2.0
    chord = speed * times * np.sinc(turn_rate * times / (2.0 * math.pi))
    path = pose[:2] + chord[:, None] * np.column_stack([np.cos(middle), np.sin(middle)])
    distance = np.linalg.norm(path[:, None] - points, axis=2)
    return distance.min(axis=0), distance.max(axis=0)


def check(pose, twist, duration, points):
    pose, points = np.array(pose), np.array(points)
    least, greatest = reach(pose, twist, duration, points)
    expected = sampled(pose, twist, duration, points)
    # Sampling misses an extreme by at most half a step of path; and the centre of an arc that is
    # almost straight is so far away that its distance is rounded to this much.
    rounding = 1e-9 + 1e-15 * abs(twist[0]) / max(abs(twist[1]), 1e-8)
    gap = abs(twist[0]) * duration / (SAMPLES - 1) / 2.0 + rounding
    assert (least <= expected[0] + rounding).all()
    assert (least >= expected[0] - gap).all()
    assert (greatest >= expected[1] - rounding).all()
    assert (greatest <= expected[1] + gap).all()


@unhurried
@given(
    pose=st.tuples(places, places, st.floats(-10.0, 10.0)),
    twist=st.tuples(st.floats(-2.0, 2.0), st.floats(-40.0, 40.0)),
    duration=st.floats(0.0, 0.5),
    points=st.lists(st.tuples(places, places), min_size=1, max_size=4),
)
def test_reach_anywhere(pose, twist, duration, points):
    check(pose, twist, duration, points)


@pytest.mark.parametrize('turn', [0.0, 1e-12, 1e-9, 1e-7, 1e-4, 1.0, 3.0, math.pi, 6.0, 7.0, 20.0])
@pytest.mark.parametrize('direction', [1.0, -1.0])
@pytest.mark.parametrize('length', [1.5, -1.5, 0.0])
def test_reach_of_arcs_of_every_kind(turn, direction, length):
    rng = np.random.default_rng(1)
    points = np.vstack([rng.uniform(-2.0, 2.0, size=(30, 2)), [[0.3, 0.4]]])
    for heading in (0.0, 1.0, -2.0, math.pi):
        check([0.3, 0.4, heading], [2.0 * length, 2.0 * direction * turn], 0.5, points)
