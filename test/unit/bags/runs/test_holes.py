"""Holes of a recording: from which interval on there is one, and what is left of the path."""

import numpy as np
import pytest

from cmpsp_ros.bags.runs import DrivenPath, holes, in_words, longest_interval, pieces
from cmpsp_ros.bags.runs.odometry import Hole
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file

SECOND = 1_000_000_000


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
