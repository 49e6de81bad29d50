"""How long control steps take where a laser scanner sees the obstacles."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.families.spread import Spread
from benchmarks.quiet import collector_off
from benchmarks.table import Table
from cmpsp_ros.guidance import GuidanceLaw, Observation, to_nanoseconds
from cmpsp_ros.parameters import (
    TABLE,
    guidance_settings,
    laser_settings,
    load_parameter_file,
    plant_settings,
    shapes_of,
)
from cmpsp_ros.simulator import Plant
from cmpsp_ros.studies.monte_carlo import Eyes
from cmpsp_ros.world.grids import distance_field

PRESETS = ('unknown', 'clutter')


@dataclass(frozen=True)
class Seen:
    """Control steps of one preset; all times [ms].

    Attributes:
        name: Of the preset.
        cells: Of the grid around the robot.
        step: From odometry to the decision, with the newest scan and the distance field of the
            grid.
        scan: To take in the newest scan, which here comes with the odometry that is decided on; in
            most steps of a robot it has come before.
        field: The distance field alone.
        search: The search of the grid, after the command.
    """

    name: str
    cells: int
    step: Spread
    scan: Spread
    field: Spread
    search: Spread


def measure(
    runs: int, presets: Sequence[str] = PRESETS, progress: Callable[[], None] = lambda: None
) -> list[Seen]:
    """Drive presets whose obstacles a scanner sees, in turn."""
    times: dict[str, list[tuple[float, ...]]] = {each: [] for each in presets}
    for run in range(runs + 1):
        for preset in presets:
            steps = list(_steps(preset))
            if run > 0:
                times[preset] += steps
        progress()
    found = []
    for preset in presets:
        *parts, cells = np.array(times[preset]).T
        found.append(Seen(preset, int(cells[0]), *map(Spread.of, parts)))
    return found


def _steps(preset: str) -> Iterator[tuple[float, ...]]:
    """Of each control step: its time, those of scan, field, search [ms], and the grid's cells."""
    values = TABLE.resolve(load_parameter_file(preset))
    settings, of_plant = guidance_settings(values), plant_settings(values)
    law, plant = GuidanceLaw(settings, settings.world), Plant(of_plant)
    eyes = Eyes(settings, laser_settings(values), shapes_of(values))
    eyes.note(plant.motion)
    period = to_nanoseconds(1.0 / of_plant.odom_rate)
    with collector_off():
        while True:
            stamp, pose = plant.stamp_ns, plant.motion.pose
            eyes.look(stamp)
            began = time.thread_time_ns()
            sighting = eyes.see(stamp, pose)
            seen = time.thread_time_ns()
            if law.is_due(stamp):
                decision = law.step(Observation(stamp, pose, (), sighting))
                decided = time.thread_time_ns()
                if decision is None or decision.finished or sighting is None:
                    return
                law.after_step()
                searched = time.thread_time_ns()
                distance_field(sighting.grid, unknown_is_free=True)
                done = time.thread_time_ns()
                scan, step, search, field = np.diff([began, seen, decided, searched, done]) * 1e-6
                yield scan + step, scan, field, search, sighting.grid.cells.size
                plant.command(stamp, *decision.twist.tolist())
            eyes.note(*plant.advance(stamp + period), plant.motion)


def table(found: Sequence[Seen]) -> Table:
    """Median and largest times."""
    rows = [
        (
            each.name,
            str(each.cells),
            f'{each.step.median:.2f}',
            f'{each.step.largest:.1f}',
            f'{each.scan.median:.2f}',
            f'{each.field.median:.2f}',
            f'{each.search.median:.1f}',
            f'{each.search.largest:.1f}',
        )
        for each in found
    ]
    columns = ('preset', 'cells', 'step', 'max', 'scan', 'field', 'search', 'max')
    note = (
        'Median and largest computing times [ms]. The step has in it: to take in the newest scan, '
        'and the distance field of the grid. The search follows the command.'
    )
    return Table('Sensors', columns, rows, note)
