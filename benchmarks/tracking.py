"""Time to track people in the scans of a laser scanner."""

import math
import time
from dataclasses import replace
from typing import Final

import numpy as np

from benchmarks.common import Spread, Table, collector_off
from cmpsp_ros.arrays import Array
from cmpsp_ros.parameters import (
    TABLE,
    guidance_settings,
    laser_settings,
    load_parameter_file,
    plant_settings,
)
from cmpsp_ros.simulator import People, PeopleSettings, Plant, Walker, discs_of, edges_of
from cmpsp_ros.studies.monte_carlo import Eyes
from cmpsp_ros.world.obstacles import Capsule

PEOPLE: Final = 12
BEAMS: Final = 720
_SCANS: Final = 300
_FIRST: Final = 20
"""Scans until the people walk and are seen to."""
_PERIOD: Final = 100_000_000
_HALL: Final = ((0.0, 0.0), (12.0, 0.0), (12.0, 6.0), (0.0, 6.0))
_MIDDLE: Final = (6.0, 3.0, 0.0)


def measure_tracking() -> tuple[Spread, float]:
    """Time that tracking adds to a scan [ms], and the mean number of tracks."""
    untracked, tracked = (_scan_times(tracks=each) for each in (False, True))
    return Spread.of(tracked[:, 0] - np.median(untracked[:, 0])), float(tracked[:, 1].mean())


def _scan_times(*, tracks: bool) -> Array:
    """Computing time [ms] and number of tracks of each scan in a hall full of people."""
    values = TABLE.resolve(load_parameter_file('unknown'))
    settings = guidance_settings(values)
    settings = replace(settings, sight=replace(settings.sight, moving=tracks, size=16.0))
    scanner = replace(
        laser_settings(values),
        rate=10.0,
        count=BEAMS,
        angle_min=-math.pi,
        angle_max=math.pi * (1.0 - 2.0 / BEAMS),
        stddev=0.01,
    )
    corners = zip(_HALL, _HALL[1:] + _HALL[:1], strict=True)
    walls = [Capsule(f'w{k}', *ends, 0.05) for k, ends in enumerate(corners)]
    walkers = tuple(
        Walker(f'p{k}', (1.0 + 0.9 * k, 1.5 + 3.0 * (k % 2)), motion='random', speed=0.4 + 0.1 * k)
        for k in range(PEOPLE)
    )
    people = People(PeopleSettings(walkers), edges_of(walls), discs_of(walls))
    eyes, found = Eyes(settings, scanner, walls, people), list[tuple[float, int]]()
    eyes.note(Plant(replace(plant_settings(values), initial_pose=_MIDDLE)).motion)
    people.begin(0)
    pose = np.array(_MIDDLE)
    with collector_off():
        for stamp in range(_PERIOD, _SCANS * _PERIOD, _PERIOD):
            for moment in range(stamp - _PERIOD, stamp + 1, _PERIOD // 5):
                people.advance(moment, pose[None, :2], settings.robot_radius)
            eyes.look(stamp)
            began = time.thread_time_ns()
            sighting = eyes.see(stamp, pose)
            took = 1e-6 * (time.thread_time_ns() - began)
            found.append((took, 0 if sighting is None else len(sighting.tracks)))
    return np.array(found[_FIRST:])


def tracking_table(found: tuple[Spread, float]) -> Table:
    """Median and largest times."""
    spread, tracks = found
    numbers = (spread.median, spread.p99 or spread.largest, spread.largest)
    row = (str(BEAMS), str(PEOPLE), f'{tracks:.1f}', *(f'{each:.2f}' for each in numbers))
    columns = ('beams', 'people', 'tracks', 'median', 'p99', 'max')
    return Table(
        'Tracking', columns, [row], 'Computing time that tracking adds to taking in a scan [ms].'
    )
