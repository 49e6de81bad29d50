"""Time to track people in the scans of a laser scanner, and a room with so many of them."""

import time
from dataclasses import replace
from typing import Final

import numpy as np

from benchmarks.common import Spread, Table, collector_off
from cmpsp_ros.guidance import GuidanceSettings
from cmpsp_ros.parameters import (
    TABLE,
    guidance_settings,
    laser_settings,
    load_parameter_file,
    plant_settings,
    shapes_of,
)
from cmpsp_ros.simulator import (
    People,
    PeopleSettings,
    Plant,
    PlantSettings,
    Walker,
    discs_of,
    edges_of,
)
from cmpsp_ros.studies.monte_carlo import Eyes

PRESET: Final = 'people'
PEOPLE: Final = 12
BEAMS: Final = 720
_SCANS: Final = 300
_FIRST: Final = 20  # scans until the people walk and are seen to
_PERIOD: Final = 100_000_000
_PLACE: Final = (5.0, 1.8, 0.0)


def among_people(*, tracked: bool = True) -> tuple[GuidanceSettings, PlantSettings, Eyes, People]:
    """The room of the preset with more people, who walk anywhere at 0.4 to 1.5 m/s."""
    values = TABLE.resolve(load_parameter_file(PRESET))
    settings, walls = guidance_settings(values), shapes_of(values)
    settings = replace(settings, sight=replace(settings.sight, moving=tracked))
    scanner = replace(laser_settings(values), rate=10.0, count=BEAMS)
    walkers = tuple(
        Walker(f'p{k}', (2.5 + 0.6 * k, 1.0 + 4.0 * (k % 2)), 'random', speed=0.4 + 0.1 * k)
        for k in range(PEOPLE)
    )
    people = People(PeopleSettings(walkers), edges_of(walls), discs_of(walls))
    return settings, plant_settings(values), Eyes(settings, scanner, walls, people), people


def measure_tracking() -> tuple[Spread, float]:
    """Time that tracking adds to a scan of a robot at rest [ms], and the mean number of tracks."""
    both = [among_people(tracked=each) for each in (False, True)]
    for _, of_plant, eyes, people in both:
        eyes.note(Plant(replace(of_plant, initial_pose=_PLACE)).motion)
        people.begin(0)
    with collector_off():
        scans = [
            [_scan(*each, stamp) for each in both]
            for stamp in range(_PERIOD, _SCANS * _PERIOD, _PERIOD)
        ]
    found = np.array(scans)[_FIRST:]
    return Spread.of(found[:, 1, 0] - np.median(found[:, 0, 0])), float(found[:, 1, 1].mean())


def _scan(
    settings: GuidanceSettings, _: PlantSettings, eyes: Eyes, people: People, stamp: int
) -> tuple[float, int]:
    """Computing time of the scan at a time [ns] in [ms], and the number of tracks."""
    pose = np.array(_PLACE)
    for moment in range(stamp - _PERIOD, stamp + 1, _PERIOD // 5):
        people.advance(moment, pose[None, :2], settings.robot_radius)
    eyes.look(stamp)
    began = time.thread_time_ns()
    sighting = eyes.see(stamp, pose)
    took = 1e-6 * (time.thread_time_ns() - began)
    return took, 0 if sighting is None else len(sighting.tracks)


def tracking_table(found: tuple[Spread, float]) -> Table:
    """Median and largest times."""
    spread, tracks = found
    numbers = (spread.median, spread.p99 or spread.largest, spread.largest)
    row = (str(BEAMS), str(PEOPLE), f'{tracks:.1f}', *(f'{each:.2f}' for each in numbers))
    columns = ('beams', 'people', 'tracks', 'median', 'p99', 'max')
    return Table(
        'Tracking', columns, [row], 'Computing time that tracking adds to taking in a scan [ms].'
    )
