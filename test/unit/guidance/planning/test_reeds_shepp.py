"""Shortest paths of a car lead where they should, and are as short as in the literature."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmpsp_ros.guidance.planning.reeds_shepp import length_of, shortest_paths

places = st.floats(-6.0, 6.0)
angles = st.floats(-math.pi, math.pi)


def end_of(path):
    x = y = heading = 0.0
    for turn, length in path:
        if turn == 0:
            x, y = x + length * math.cos(heading), y + length * math.sin(heading)
            continue
        after = heading + turn * length
        x += turn * (math.sin(after) - math.sin(heading))
        y -= turn * (math.cos(after) - math.cos(heading))
        heading = after
    return x, y, heading


@given(places, places, angles)
def test_every_path_ends_at_the_pose(x, y, heading):
    paths = shortest_paths(x, y, heading)
    assert paths
    for path in paths:
        end_x, end_y, end_heading = end_of(path)
        assert math.dist((end_x, end_y), (x, y)) < 1e-6
        assert abs(math.remainder(end_heading - heading, math.tau)) < 1e-6
    lengths = [length_of(path) for path in paths]
    assert lengths == sorted(lengths)


@given(places, places, angles)
def test_the_way_back_is_as_long(x, y, heading):
    cosine, sine = math.cos(heading), math.sin(heading)
    back = shortest_paths(-(x * cosine + y * sine), x * sine - y * cosine, -heading)
    assert length_of(back[0]) == pytest.approx(
        length_of(shortest_paths(x, y, heading)[0]), abs=1e-6
    )


@pytest.mark.parametrize(
    ('pose', 'length'),
    [
        ((3.0, 0.0, 0.0), 3.0),
        ((-3.0, 0.0, 0.0), 3.0),
        ((1.0, 1.0, math.pi / 2.0), math.pi / 2.0),
        # Turning round on the spot: three arcs of 60 degrees.
        ((0.0, 0.0, math.pi), math.pi),
    ],
)
def test_known_lengths(pose, length):
    assert length_of(shortest_paths(*pose)[0]) == pytest.approx(length, abs=1e-9)
