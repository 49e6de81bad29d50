"""Groups of cells that hang together."""

import numpy as np

from cmpsp_ros.world.grids import small_groups

CELLS = np.array(
    [
        [1, 0, 0, 0, 0, 0, 0],
        [1, 0, 1, 0, 0, 1, 0],
        [0, 0, 0, 1, 0, 0, 0],
        [0, 0, 0, 0, 0, 0, 0],
        [0, 1, 1, 1, 1, 0, 0],
        [0, 0, 0, 0, 0, 0, 1],
    ],
    dtype=bool,
)


def test_groups_hang_together_at_corners_and_count_by_their_longer_side():
    found = [group.tolist() for group in small_groups(CELLS, 2, 3)]
    assert found == [[[1, 2], [2, 3]]]
    assert [len(group) for group in small_groups(CELLS, 1, 4)] == [2, 1, 4]


def test_where_nothing_is_there_are_no_groups():
    assert small_groups(np.zeros((4, 4), dtype=bool), 1, 4) == []
