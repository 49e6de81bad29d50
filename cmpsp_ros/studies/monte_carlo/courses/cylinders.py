"""Fields of cylinders from cellular automata, as of the BARN data set.

Perille, Truong, Xiao and Stone, Benchmarking Metric Ground Navigation, SSRR 2020. Each field has a
way for a square of five cells, and so for a disc with a radius of 37 cm.
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.arrays import BoolArray
from cmpsp_ros.guidance import GuidanceSettings
from cmpsp_ros.studies.monte_carlo.courses.scenario import Scenario
from cmpsp_ros.world.obstacles import Capsule, Obstacle

Cells = BoolArray

SIZE: Final = 30
"""Cells along either side of the field."""

CELL: Final = 0.15
RADIUS: Final = 0.075
GOAL: Final = (10.0, SIZE * CELL / 2.0)
_BEGIN: Final = 2.75
_BEYOND: Final = 1.0

_FILLED: Final = (0.15, 0.2, 0.25, 0.3)
"""Fraction of the cells that are filled at first, from one run to the next."""

_GENERATIONS: Final = 5
_CROWDED, _LONELY = 4, 2
_KERNEL: Final = 5
_ATTEMPTS: Final = 50


def field_scenario(
    settings: GuidanceSettings, seed: int, number: int, _most_obstacles: int
) -> Scenario:
    """A field between two walls, with start and goal beside it; arguments as of `scenario`."""
    random = np.random.default_rng(np.random.SeedSequence([seed, number]))
    plant_seed, filled = int(random.integers(2**31)), _FILLED[number % len(_FILLED)]
    cells = _field(random, filled)
    attempts = 1
    while not is_open(cells):
        # Dense fields are hardly ever open.
        cells = _field(random, filled - 0.01 * (attempts // _ATTEMPTS))
        attempts += 1
    walls = [
        Capsule(f'wall{k}', (-_BEYOND, y), (GOAL[0] + _BEYOND, y), RADIUS)
        for k, y in enumerate((0.0, SIZE * CELL))
    ]
    places = [(_BEGIN + (j + 0.5) * CELL, (i + 0.5) * CELL) for i, j in np.argwhere(cells)]
    cylinders = [Obstacle(f'c{k}', place, RADIUS) for k, place in enumerate(places)]
    pose = (0.0, GOAL[1], 0.0)
    time = math.ceil(GOAL[0] / settings.pace) + 2.0
    changes = {'goal': GOAL, 'final_time': float(time)}
    return Scenario(number, pose, (*walls, *cylinders), plant_seed, changes)


def is_open(cells: Cells) -> bool:
    """Whether a square of five cells can go from one side of a field to the other."""
    from scipy import ndimage  # noqa: PLC0415 (it takes half a second to load)

    windows = np.lib.stride_tricks.sliding_window_view(cells, (_KERNEL, _KERNEL))
    groups, _ = ndimage.label(~windows.any(axis=(2, 3)))
    shared = set(groups[:, 0].tolist()) & set(groups[:, -1].tolist())
    return bool(shared - {0})


def _field(random: np.random.Generator, filled: float) -> Cells:
    cells = random.random((SIZE, SIZE)) < filled
    cells[[0, -1]] = True
    for _ in range(_GENERATIONS):
        count = _neighbours(cells)
        cells = (cells & (count >= _LONELY)) | (count > _CROWDED)
    return cells


def _neighbours(cells: Cells) -> NDArray[Any]:
    """How many of the eight around each cell are filled; what is beside the walls is."""
    around = np.pad(cells.astype(int), ((1, 1), (0, 0)), constant_values=1)
    around = np.pad(around, ((0, 0), (1, 1)))
    windows = np.lib.stride_tricks.sliding_window_view(around, (3, 3))
    return np.asarray(windows.sum(axis=(2, 3)) - cells)
