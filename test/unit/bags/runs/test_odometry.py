"""The path through odometry, found from poses alone, and the holes in it."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmpsp_ros.bags.runs import DrivenPath, holes, in_words, longest_interval, pieces
from cmpsp_ros.bags.runs.odometry import Hole, OdometrySeries, interpolated, path_through, wrapped
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file
from cmpsp_ros.robots.motion import arc_ends

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
TWISTS = st.tuples(st.floats(-2.0, 2.0), st.floats(-3.0, 3.0))


def odometry(stamps, poses):
    stamps = np.array(stamps, dtype=np.int64)
    return OdometrySeries(stamps, stamps, np.array(poses, dtype=float), np.zeros((len(stamps), 2)))


def driven(twists, seconds):
    poses = [np.array([1.0, 2.0, 3.0])]
    for twist in twists:
        poses.append(arc_ends(poses[-1][None], np.array([twist]), np.array([seconds]))[0])
    poses = np.array(poses)
    poses[:, 2] = wrapped(poses[:, 2])
    stamps = START + np.arange(len(poses)) * round(seconds * SECOND)
    return odometry(stamps, poses)


@given(st.lists(TWISTS, min_size=1, max_size=5), st.sampled_from([0.02, 0.1, 1.0]))
def test_arcs_that_were_driven_are_found_again(twists, seconds):
    path = path_through(driven(twists, seconds))
    for found, twist in zip(path.twists, twists, strict=False):
        assert found[1] == pytest.approx(twist[1], abs=1e-6)
        # Of a robot that hardly moves nobody can tell the direction.
        if abs(twist[0]) > 1e-3:
            assert found[0] == pytest.approx(twist[0], abs=1e-6)
    assert path.twists[-1].tolist() == [0.0, 0.0]


POSES = st.tuples(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0), st.floats(-math.pi, math.pi))


@given(st.lists(POSES, min_size=2, max_size=6))
def test_every_arc_ends_where_the_next_begins_whatever_the_poses(poses):
    path = path_through(odometry(START + np.arange(len(poses)) * SECOND, poses))
    assert np.isfinite(path.poses).all()
    ends = arc_ends(path.poses[:-1], path.twists[:-1], path.durations)
    assert ends[:, :2] == pytest.approx(np.array(poses)[1:, :2], abs=1e-6)


def test_what_came_out_of_order_is_left_out_and_a_jump_begins_a_leg():
    seconds = [10.0, 10.2, 10.1, 10.3, 2.0, 2.1]
    poses = np.arange(18.0).reshape(6, 3)
    stamps = [round(each * SECOND) for each in seconds]
    first, second = odometry(stamps, poses).legs(0.5)
    assert (first.stamps / SECOND).tolist() == [10.0, 10.2, 10.3]
    assert (second.stamps / SECOND).tolist() == [2.0, 2.1]
    assert first.poses[:, 0].tolist() == [0.0, 3.0, 9.0]


def test_between_samples_it_is_interpolated_across_the_jump_of_the_heading():
    found = interpolated(
        odometry([START, START + SECOND], [[0.0, 0.0, 3.1], [1.0, 2.0, -3.1]]),
        np.array([START + SECOND // 2]),
    )
    assert found[0, :2].tolist() == [0.5, 1.0]
    assert abs(wrapped(found[:, 2])[0]) == pytest.approx(math.pi)


def stamps(*seconds):
    return np.round(np.multiply(seconds, SECOND)).astype(np.int64)


def settings(**changes):
    return guidance_settings(TABLE.resolve({**load_parameter_file('case3'), **changes}))


@pytest.mark.parametrize(
    ('interval', 'changes', 'longest'),
    [(0.02, {}, 0.21), (0.02, {'odom_timeout': 0.1}, 0.11), (0.1, {}, 0.3), (1.0, {}, 3.0)],
)
def test_a_hole_is_longer_than_messages_and_commands_are_apart(interval, changes, longest):
    regular = stamps(*np.arange(0.0, 10.0, interval))
    assert longest_interval(regular, settings(**changes)) == pytest.approx(longest * SECOND)


def test_what_is_beyond_the_ends_is_missing_too():
    known = stamps(1.0, 1.1, 2.0, 2.1)
    found = holes(known, 0, 3 * SECOND, SECOND // 2)
    assert found == (
        Hole(0, SECOND),
        Hole(*stamps(1.1, 2.0).tolist()),
        Hole(*stamps(2.1, 3.0).tolist()),
    )
    assert in_words(found[1:2], SECOND) == 'from 0.10 to 1.00 s (0.90 s)'


def test_pieces_are_what_lies_between_the_holes():
    known = stamps(0.0, 0.1, 0.2, 1.0, 2.0, 2.1)
    x = np.arange(6.0)
    path = DrivenPath(known, np.column_stack([x, 0 * x, 0 * x]), np.tile([10.0, 0.0], (6, 1)))
    found = list(pieces(path, SECOND // 10, 3 * SECOND, SECOND // 2))
    assert [each.stamps.tolist() for each in found] == [
        stamps(0.1, 0.2).tolist(),
        [SECOND, SECOND + 1],
        stamps(2.0, 2.1).tolist(),
    ]
    # A pose alone is a place where the robot was, and leads nowhere.
    assert found[1].poses[:, 0].tolist() == [3.0, 3.0]
    assert not found[1].twists.any()
