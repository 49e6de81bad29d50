"""Distances of cells from squares, against all squares one by one."""

import math

import numpy as np
import pytest

from cmpsp_ros.world.grids.distance_field import signed_distances


def from_each_square(marked: np.ndarray) -> np.ndarray:
    rows, columns = np.nonzero(marked)
    found = np.empty(marked.shape)
    for i, j in np.ndindex(marked.shape):
        up = np.maximum(np.abs(rows - i) - 0.5, 0.0)
        across = np.maximum(np.abs(columns - j) - 0.5, 0.0)
        found[i, j] = np.sqrt((2.0 * up) ** 2 + (2.0 * across) ** 2).min() / 2.0
    return found


@pytest.mark.parametrize('share', [0.01, 0.1, 0.5, 0.95])
@pytest.mark.parametrize('seed', range(10))
def test_distances_are_exact_to_the_last_bit(seed: int, share: float) -> None:
    random = np.random.default_rng(seed)
    marked = random.random(random.integers(2, 40, 2)) < share
    marked[0, random.integers(marked.shape[1])] = True
    marked[-1, random.integers(marked.shape[1])] = False

    expected = from_each_square(marked)
    expected[marked] = -from_each_square(~marked)[marked]

    assert np.array_equal(signed_distances(marked), expected)


def test_without_a_mark_distances_are_infinite() -> None:
    assert (signed_distances(np.zeros((3, 4), dtype=bool)) == math.inf).all()
    assert (signed_distances(np.ones((3, 4), dtype=bool)) == -math.inf).all()


def test_a_single_row_and_a_single_column() -> None:
    assert signed_distances(np.array([[False, False, True]])).tolist() == [[1.5, 0.5, -0.5]]
    assert signed_distances(np.array([[True], [False]])).tolist() == [[-0.5], [0.5]]
