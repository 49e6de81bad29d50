"""How a control step's time grows with the number of obstacles, that stand or that move."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from benchmarks.families.presets import Preset, drive
from benchmarks.table import Table
from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import GuidanceSettings, MovingObstacles
from cmpsp_ros.guidance.messages import Track
from cmpsp_ros.world.obstacles import Obstacle

COUNTS = (0, 1, 2, 4, 8, 16, 32, 64)

_ASIDE = 0.75
"""Of each from the centre line, to either side in turn [m]."""

_RADIUS = 0.2
_SPEED = 0.1
_BEARINGS = (math.radians(-72.0), math.radians(-6.0))
"""Of the first and the last, about the road's centre; case 3 goes from -90 to 0 degrees."""


@dataclass(frozen=True)
class Many:
    """Control steps past a number of obstacles.

    Attributes:
        count: How many there are.
        standing: Median of all steps where they stand [us].
        moving: Median where they move along the road [us].
        first: Longest first step where they stand, which looks for ways between them [us].
    """

    count: int
    standing: float
    moving: float
    first: float


def measure(
    runs: int, counts: Sequence[int] = COUNTS, progress: Callable[[], None] = lambda: None
) -> list[Many]:
    """Drive case 3's road past obstacles on both sides, all numbers of them in turn."""
    preset = Preset.load('case3')
    times: dict[tuple[int, bool], list[Array]] = {}
    for run in range(runs + 1):
        for count in counts:
            for moving in (False, True):
                steps = _step_times(preset, count, moving=moving)
                if run > 0:
                    times.setdefault((count, moving), []).append(steps)
        progress()
    return [
        Many(
            count,
            float(np.median(np.concatenate(times[count, False]))),
            float(np.median(np.concatenate(times[count, True]))),
            max(float(steps[0]) for steps in times[count, False]),
        )
        for count in counts
    ]


def table(found: Sequence[Many]) -> Table:
    """The times, and each beside that without obstacles."""
    none = found[0]
    rows = [
        (
            str(each.count),
            f'{each.standing:.0f}',
            f'{each.standing / none.standing:.2f}',
            f'{each.moving:.0f}',
            f'{each.moving / none.moving:.2f}',
            f'{each.first / 1e3:.1f}',
        )
        for each in found
    ]
    columns = ('obstacles', 'standing [us]', 'ratio', 'moving [us]', 'ratio', 'first step [ms]')
    note = f'Median computing time of control steps; ratios are to {none.count} obstacles.'
    return Table('Obstacles', columns, rows, note)


def tracks_of_some(count: int, stamp: int) -> tuple[Track, ...]:
    """As many obstacles along the road, as they are at a time [ns] since the beginning."""
    tracks = []
    for number, (bearing, radius) in enumerate(_places(count)):
        rate = _SPEED / radius
        now = bearing + rate * stamp / 1e9
        x, y = radius * math.cos(now), radius * math.sin(now)
        vx, vy = -_SPEED * math.sin(now), _SPEED * math.cos(now)
        tracks.append(Track(number, stamp, _RADIUS, x, y, vx, vy))
    return tuple(tracks)


def _places(count: int) -> list[tuple[float, float]]:
    """Bearings and distances from the road's centre of obstacles, evenly apart."""
    bearings = np.linspace(*_BEARINGS, count).tolist()
    return [(each, 10.0 + _ASIDE * (-1.0) ** k) for k, each in enumerate(bearings)]


def _settings(settings: GuidanceSettings, count: int, *, moving: bool) -> GuidanceSettings:
    if moving:
        room = MovingObstacles(capacity=count, growth=0.0)
        return replace(settings, obstacles=(), moving_obstacles=room)
    discs = (
        Obstacle(str(k), (radius * math.cos(bearing), radius * math.sin(bearing)), _RADIUS)
        for k, (bearing, radius) in enumerate(_places(count))
    )
    return replace(settings, obstacles=tuple(discs))


def _step_times(preset: Preset, count: int, *, moving: bool) -> Array:
    """Computing time of each control step of one run, waiting for a processor left out [us]."""
    settings = _settings(preset.settings, count, moving=moving)
    tracks = partial(tracks_of_some, count if moving else 0)
    steps = drive(settings, preset.pose, time.thread_time_ns, tracks)
    return 1e3 * np.array([took for took, *_ in steps])
