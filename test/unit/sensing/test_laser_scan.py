"""Laser scans: what each range means, what is refused, and where beams end in the world."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from cmpsp_ros.sensing import ScanError, Sensor, sight_of
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
        (scan((math.nan,) * 5), 'ranges: found 5 times NaN, wanted a range'),
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
    beams = sight.projected(history.at(sight.stamps))
    ends = beams.ends[beams.hits]
    assert len(ends) > 200
    from_walls = np.minimum(np.abs(ends[:, 0] - 3.0), np.abs(ends[:, 0] + 4.0))
    from_walls = np.minimum(from_walls, np.abs(ends[:, 1] - 3.0))
    # An arc of 20 ms strays 50 um from its chord.
    assert from_walls.max() < 1e-3
    still = sight.projected(history.at(np.full(401, seen.stamp_ns)))
    assert np.abs(still.ends - beams.ends).max() > 0.3
