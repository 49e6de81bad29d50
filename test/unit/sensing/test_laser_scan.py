"""Laser scans: what each range means, what is refused, and where beams end in the world."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from cmpsp_ros.sensing import ScanError, Sensor, projected, sight_of
from cmpsp_ros.sensing.surroundings import PoseHistory
from cmpsp_ros.simulator import Laser, LaserSettings, Motion

SENSOR = Sensor('front', 'base_scan', (0.3, -0.1, 0.5), reach=9.0)
HEADER = {
    'angle_min': -1.0, 'angle_max': 1.0, 'angle_increment': 0.5, 'time_increment': 0.0,
    'scan_time': 0.1, 'range_min': 0.2, 'range_max': 8.0,
}  # fmt: skip


def scan(ranges=(1.0,) * 5, *, frame='base_scan', stamp=(3, 500), **changes):
    header = SimpleNamespace(frame_id=frame, stamp=SimpleNamespace(sec=stamp[0], nanosec=stamp[1]))
    return SimpleNamespace(header=header, ranges=ranges, **{**HEADER, **changes})


def lengths(sight):
    return np.hypot(*sight.ends.T)


def test_what_each_range_means():
    ranges = [1.5, math.inf, math.nan, -math.inf, 0.0]
    sight = sight_of(scan(ranges), SENSOR)
    assert lengths(sight) == pytest.approx([1.5, 8.0, 0.0, 0.2, 0.0])
    assert sight.hits.tolist() == [True, False, False, True, False]
    assert np.arctan2(*sight.ends[:2, ::-1].T) == pytest.approx([-1.0, -0.5])
    assert sight.is_sweep
    # Out of range, though finite: nothing known.
    sight = sight_of(scan([9.0, 8.0, 0.2, 0.1, -1.0]), SENSOR)
    assert lengths(sight) == pytest.approx([0.0, 8.0, 0.2, 0.0, 0.0])
    assert sight.hits.tolist() == [False, True, True, False, False]


def test_beyond_the_reach_of_a_sensor_nothing_is_used():
    sight = sight_of(scan([1.0, 3.0, 5.0, math.inf, math.nan]), Sensor('a', 'base_scan', reach=3.0))
    assert lengths(sight) == pytest.approx([1.0, 3.0, 3.0, 3.0, 0.0])
    assert sight.hits.tolist() == [True, True, False, False, False]


def test_beams_have_the_times_at_which_they_were_measured():
    sight = sight_of(scan(time_increment=1e-3), SENSOR)
    assert (sight.stamps - 3_000_000_500).tolist() == [0, 1e6, 2e6, 3e6, 4e6]
    assert sight.stamp == 3_004_000_500


@pytest.mark.parametrize(
    ('message', 'reason'),
    [
        (scan(frame='odom'), r"front: frame_id: found 'odom', wanted 'base_scan' \(sensors.front"),
        (scan(angle_min=math.nan), 'front: angle_min: found nan, wanted a finite number'),
        (scan(angle_max=math.inf), 'front: angle_max: found inf, wanted a finite number'),
        (scan(angle_increment=math.nan), 'front: angle_increment: found nan'),
        (scan(time_increment=math.inf), 'front: time_increment: found inf'),
        (scan(range_min=math.nan), 'front: range_min: found nan'),
        (scan(range_max=math.inf), 'front: range_max: found inf'),
        (scan(angle_increment=0.0), 'angle_increment: found 0 rad, wanted angles that increase'),
        (scan(angle_increment=-0.5), 'angle_increment: found -0.5 rad'),
        (scan(time_increment=-1e-3), 'time_increment: found -0.001 s, wanted 0 or more'),
        (scan(time_increment=1e9), r'time_increment: found 1e\+09 s, 4e\+09 s in all'),
        (scan(range_min=9.0), 'range_min, range_max: found 9 to 8 m'),
        (scan(range_min=-1.0), 'range_min, range_max: found -1 to 8 m'),
        (scan(()), 'ranges: found 0, wanted 5 from'),
        (scan((1.0,) * 3), 'ranges: found 3, wanted 5 from'),
        (scan((1.0,) * 7), 'ranges: found 7, wanted 5 from'),
        (scan(angle_min=1.0, angle_max=-1.0), 'ranges: found 5, wanted 1 from'),
        (scan((1.0,) * 41, angle_max=19.0), 'angle_max: found -1 to 19 rad, wanted a full turn'),
        (scan((math.nan,) * 5), 'found 5, none of them valid, the first nan, wanted one of'),
        (scan((0.0,) * 5), 'ranges: found 5, none of them valid, the first 0, wanted'),
        (scan((math.nan, 0.0, 99.0, 0.0, math.nan)), 'ranges: found 5, none of them valid'),
    ],
)
def test_a_scan_that_is_refused(message, reason):
    with pytest.raises(ScanError, match=reason):
        sight_of(message, SENSOR)


@pytest.mark.parametrize('count', [4, 6])
def test_drivers_may_count_one_end_of_the_angles_more_or_less(count):
    assert len(sight_of(scan((1.0,) * count), SENSOR).ends) == count


def test_beams_end_on_walls_while_the_robot_moves():
    """Scans of the simulator on a robot that drives a curve show the obstacles where they are."""
    stamp, pose, twist = 0, np.array([0.5, -0.2, 3.0]), np.array([1.0, 2.0])
    settings = LaserSettings(
        rate=5.0, pose=SENSOR.pose, angle_min=-2.0, angle_max=2.0, count=401, time_increment=4e-4,
        range_min=0.1, range_max=8.0,
    )  # fmt: skip
    laser, history = Laser(settings, 0), PoseHistory(1_000_000_000)
    walls = np.array([[3.0, -3.0, 3.0, 3.0], [-4.0, 3.0, -4.0, -3.0], [3.0, 3.0, -4.0, 3.0]])
    for stamp in range(0, 200_000_001, 20_000_000):
        seconds, heading = 1e-9 * stamp, pose[2] + 2e-9 * stamp
        x = pose[0] + 0.5 * (math.sin(heading) - math.sin(pose[2]))
        y = pose[1] - 0.5 * (math.cos(heading) - math.cos(pose[2]))
        assert seconds <= 0.2
        laser.note(Motion(stamp, np.array([x, y, heading]), np.zeros(2), twist))
        # As odometry has it: wrapped.
        history.add(stamp, np.array([x, y, math.remainder(heading, math.tau)]))
    seen = laser.scan(walls, np.empty((0, 5)))
    message = scan(
        seen.ranges.astype(np.float32), stamp=(0, seen.stamp_ns), angle_min=-2.0, angle_max=2.0,
        angle_increment=0.01, time_increment=4e-4, range_min=0.1,
    )  # fmt: skip
    sight = sight_of(message, SENSOR)
    beams = projected(sight, history.at(sight.stamps))
    ends = beams.ends[beams.hits]
    assert len(ends) > 200
    from_walls = np.minimum(np.abs(ends[:, 0] - 3.0), np.abs(ends[:, 0] + 4.0))
    from_walls = np.minimum(from_walls, np.abs(ends[:, 1] - 3.0))
    # An arc of 20 ms strays 50 um from its chord.
    assert from_walls.max() < 1e-3
    still = projected(sight, history.at(np.full(401, seen.stamp_ns)))
    assert np.abs(still.ends - beams.ends).max() > 0.3


KINDS = {'i4': 5, 'f4': 7, 'f8': 8}
DEPTH_CAMERA = Sensor('depth', 'camera', reach=5.0, heights=(-0.5, 1.0), type='cloud')
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
    sight = sight_of(cloud(kinds=kinds, pad=pad, tail=tail, big=big, height=height), DEPTH_CAMERA)
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
    sight = sight_of(cloud([point]), replace(DEPTH_CAMERA, heights=heights))
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
    assert sight_of(cloud([*floor, *wall]), DEPTH_CAMERA).hits.tolist() == [True] * 10 + [False]


def test_the_origin_of_beams_is_the_place_of_the_sensor():
    """They begin farther on, where they come down to the heights that count."""
    camera = replace(DEPTH_CAMERA, pose=(0.3, -0.1, 0.5), heights=(-1.4, -0.3))
    sight = sight_of(cloud([(1.0, 0.5, -1.0), (2.0, 0.0, -1.5)]), camera)
    driven = np.array([[1.0, 2.0, math.pi / 2.0], [1.2, 2.0, math.pi / 2.0]])
    beams = projected(sight, driven)
    assert beams.origin == pytest.approx([1.2, 2.3])
    assert np.hypot(*(beams.starts - beams.origin).T).min() > 0.2
    nothing = projected(sight_of(cloud([]), camera), np.empty((0, 3)))
    assert nothing.origin.tolist() == [0.0, 0.0]


def test_where_no_point_is_nothing_is_known():
    points = [(math.nan, math.nan, math.nan), (math.inf, 0.0, 0.0), (2.0, 0.0, 0.0)] * 2
    sight = sight_of(cloud(points), DEPTH_CAMERA)
    assert sight.ends.tolist() == [[2.0, 0.0]] * 2
    assert sight.hits.all()
    assert sight_of(cloud([]), DEPTH_CAMERA).ends.shape == (0, 2)


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
        sight_of(message, DEPTH_CAMERA)
