"""Where the robot was: between two poses, across half a turn, and for how long."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cmpsp_ros.sensing.pose_history import PoseHistory


def history(*poses, span=1000):
    known = PoseHistory(span)
    for stamp, *pose in poses:
        known.add(stamp, np.array(pose, dtype=float))
    return known


def test_poses_between_two_of_them():
    known = history((100, 0.0, 0.0, 0.0), (200, 1.0, 2.0, 0.5))
    assert known.at(np.array([100, 150, 200])).tolist() == [
        [0.0, 0.0, 0.0],
        [0.5, 1.0, 0.25],
        [1.0, 2.0, 0.5],
    ]


def test_headings_go_the_short_way():
    known = history((0, 0.0, 0.0, 3.0), (100, 0.0, 0.0, -3.0), (200, 0.0, 0.0, 3.0))
    turned = known.at(np.array([50, 150]))[:, 2]
    assert turned == pytest.approx([math.pi, math.pi])


def test_what_is_known():
    known = history((100, 0, 0, 0), (200, 0, 0, 0))
    assert [known.is_before(each) for each in (200, 201)] == [False, True]
    assert [known.is_after(each) for each in (99, 100)] == [True, False]
    assert history().is_before(0)
    assert not history().is_after(0)
    known.forget()
    assert known.is_before(0)


def test_old_poses_are_forgotten_but_for_the_last_one_before_the_span():
    known = history(*((100 * k, k, 0, 0) for k in range(20)), span=250)
    assert known.is_after(1599)
    assert known.at(np.array([1650]))[0, 0] == 16.5


def test_a_pose_that_is_not_newer_is_left_out():
    known = history((100, 1, 0, 0), (100, 2, 0, 0), (50, 3, 0, 0))
    assert known.at(np.array([100]))[0, 0] == 1.0


@pytest.mark.parametrize('count', [1, 2, 5])
def test_no_instants_have_no_poses(count):
    known = history(*((100 * k, k, 0, 0) for k in range(count)))
    assert known.at(np.array([], dtype=np.int64)).shape == (0, 3)
