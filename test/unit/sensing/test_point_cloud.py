"""Clouds of points: of any layout, at the heights that count, and what is refused."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from cmpsp_ros.sensing import ScanError, Sensor, sight_of

KINDS = {'i4': 5, 'f4': 7, 'f8': 8}
SENSOR = Sensor('depth', 'camera', reach=5.0, heights=(-0.5, 1.0), type='cloud')
POINTS = [
    (1.0, 2.0, 0.0),
    (1.5, 0.0, 1.0),
    (1.0, 0.0, 1.1),
    (1.0, 0.0, -0.6),
    (4.0, 3.1, 0.0),
    (math.nan, 0.0, 0.0),
]
SEEN = [[1.0, 2.0], [1.5, 0.0]]


def cloud(points=POINTS, kinds='fff', *, big=False, pad=0, height=1, tail=0, **changes):
    """Points in rows, with bytes between points and behind each row."""
    kind = {'f': 'f4', 'd': 'f8', 'i': 'i4'}
    formats = [('>' if big else '<') + kind[each] for each in kinds]
    offsets = np.cumsum([pad, *(np.dtype(each).itemsize + pad for each in formats[:-1])]).tolist()
    size = offsets[-1] + np.dtype(formats[-1]).itemsize + pad
    names = ['x', 'y', 'z']
    layout = np.dtype({'names': names, 'formats': formats, 'offsets': offsets, 'itemsize': size})
    wide = len(points) // height
    rows = np.array(points, dtype=layout).reshape(height, wide)
    message = SimpleNamespace(
        header=SimpleNamespace(frame_id='camera', stamp=SimpleNamespace(sec=2, nanosec=7)),
        height=height,
        width=wide,
        fields=[
            SimpleNamespace(name=name, offset=at, datatype=KINDS[form[1:]], count=1)
            for name, at, form in zip('xyz', offsets, formats, strict=True)
        ],
        is_bigendian=big,
        point_step=layout.itemsize,
        row_step=layout.itemsize * wide + tail,
        data=b''.join(row.tobytes() + b'\xff' * tail for row in rows),
    )
    vars(message).update(changes)
    return message


@pytest.mark.parametrize('big', [False, True])
@pytest.mark.parametrize(('pad', 'tail'), [(0, 0), (3, 0), (1, 5)])
@pytest.mark.parametrize('kinds', ['fff', 'ddd', 'fdf'])
@pytest.mark.parametrize('height', [1, 2, 3])
def test_points_of_any_layout(kinds, pad, tail, big, height):
    sight = sight_of(cloud(kinds=kinds, pad=pad, tail=tail, big=big, height=height), SENSOR)
    assert sight.ends[sight.hits].tolist() == SEEN
    assert sight.hits.tolist() == [True] * 2 + [False] * 3
    assert not sight.is_sweep
    assert sight.stamp == 2_000_000_007
    assert sight.stamps.tolist() == [2_000_000_007] * 5


@pytest.mark.parametrize('heights', [(-0.25, 0.25), (-0.25, -0.125), (0.125, 0.25), (0.0, 0.25)])
@pytest.mark.parametrize(
    'point', [(4.0, 0.0, -0.5), (2.0, 1.0, 0.5), (16.0, 12.0, -0.5), (8.0, -6.0, 0.0),
              (8.0, 6.0, 0.25), (3.0, 0.0, -0.125), (1.0, 0.0, 0.0), (0.0, 0.0, -0.5)]
)  # fmt: skip
def test_a_beam_counts_where_it_is_at_heights_that_count_and_in_reach(point, heights):
    sight = sight_of(cloud([point]), replace(SENSOR, heights=heights))
    x, y, z = point
    is_met = heights[0] <= z <= heights[1] and math.hypot(x, y) <= 5.0
    along = np.linspace(0.0, 1.0, 100_001)
    counts = (along * z >= heights[0]) & (along * z <= heights[1])
    counts &= along * math.hypot(x, y) <= 5.0
    if counts.sum() <= 1 and not is_met:
        assert len(sight.ends) == 0
        return
    first, last = along[counts][[0, -1]]
    assert sight.hits.tolist() == [is_met]
    assert np.allclose(sight.begins, [[first * x, first * y]], atol=1e-3)
    assert np.allclose(sight.ends, [[last * x, last * y]], atol=1e-3)


def test_of_beams_that_end_side_by_side_one_frees_the_cells():
    floor = [(2.0, 0.0 + 0.001 * k, -1.0) for k in range(10)]
    wall = [(1.0, 0.0 + 0.001 * k, 0.5) for k in range(10)]
    assert sight_of(cloud([*floor, *wall]), SENSOR).hits.tolist() == [True] * 10 + [False]


def test_where_no_point_is_nothing_is_known():
    points = [(math.nan, math.nan, math.nan), (math.inf, 0.0, 0.0), (2.0, 0.0, 0.0)] * 2
    sight = sight_of(cloud(points), SENSOR)
    assert sight.ends.tolist() == [[2.0, 0.0]] * 2
    assert sight.hits.all()
    assert sight_of(cloud([]), SENSOR).ends.shape == (0, 2)


@pytest.mark.parametrize(
    ('message', 'reason'),
    [
        (
            cloud(header=SimpleNamespace(frame_id='odom', stamp=None)),
            r"depth: frame_id: found 'odom', wanted 'camera' \(sensors.depth.frame_id\)",
        ),
        (cloud(kinds='ffi', points=POINTS[:1]), "field 'z': found 1 of datatype 5, wanted a float"),
        (cloud(fields=[]), "depth: field 'x': found none, wanted a float32 or float64"),
        (cloud(width=7), 'depth: data: found 72 bytes, wanted 1 rows of 72 with 7 points of 12'),
        (cloud(point_step=8), 'depth: data: found 72 bytes'),
        (cloud(row_step=70), 'depth: data: found 72 bytes'),
        (cloud(data=b''), 'depth: data: found 0 bytes'),
        (cloud(width=2**31), 'width, height: found 2147483648 points, wanted'),
        (cloud([(math.nan, 1.0, 1.0), (1.0, math.inf, 0.0)]), 'data: found 2 points, none finite'),
    ],
)
def test_a_cloud_that_is_refused(message, reason):
    with pytest.raises(ScanError, match=reason):
        sight_of(message, SENSOR)
