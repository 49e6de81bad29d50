"""Control steps with many plans, with many obstacles, and where a laser scanner sees them."""

import itertools
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, TypeAlias

import numpy as np

from benchmarks.common import BenchError, Spread, Table, collector_off, in_turn
from benchmarks.drives import Preset, step_times
from benchmarks.tracking import PRESET, among_people
from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import (
    GuidanceLaw,
    GuidanceSettings,
    MovingObstacles,
    Observation,
    to_nanoseconds,
)
from cmpsp_ros.guidance.messages import Track
from cmpsp_ros.guidance.planning import search_ahead
from cmpsp_ros.parameters import (
    TABLE,
    guidance_settings,
    laser_settings,
    load_parameter_file,
    plant_settings,
    shapes_of,
)
from cmpsp_ros.simulator import People, Plant, PlantSettings
from cmpsp_ros.studies.monte_carlo import Eyes, Study
from cmpsp_ros.world.grids import distance_field
from cmpsp_ros.world.obstacles import Obstacle

PLAN_COUNTS: Final = (1, 2, 4, 8)

# Small and on the centre line: all ways past them are about as good.
_PLAN_BEARINGS = (-65.0, -48.0, -31.0, -14.0)
_PLAN_RADIUS = 0.15


@dataclass(frozen=True)
class PlansTiming:
    """Times of the first step of so many plans, a path search in it, and the next [us]."""

    count: int
    first: Array
    second: Array


def measure_plans(
    runs: int, counts: Sequence[int] = PLAN_COUNTS, progress: Callable[[], None] = lambda: None
) -> list[PlansTiming]:
    """Begin Case 3 past four small obstacles on the centre line, all numbers of plans in turn."""
    preset = Preset.load('case3')
    every = {count: _plan_settings(preset.settings, count) for count in counts}
    laws = {
        count: partial(_two_steps, GuidanceLaw(each, each.world), preset, count)
        for count, each in every.items()
    }
    in_turn(laws, 1, progress)
    times = in_turn(laws, runs, progress)
    return [PlansTiming(count, *np.reshape(found, (-1, 2)).T) for count, found in times.items()]


def _plan_settings(settings: GuidanceSettings, count: int) -> GuidanceSettings:
    middle = settings.world.annulus.center_radius
    obstacles = tuple(
        Obstacle(
            f'at_{bearing:g}',
            (middle * math.cos(math.radians(bearing)), middle * math.sin(math.radians(bearing))),
            _PLAN_RADIUS,
        )
        for bearing in _PLAN_BEARINGS
    )
    guess = replace(settings.initial_guess, type='road')
    # As many iterations in the first step as in any other.
    each = settings.solver.iterations_per_step
    solver = replace(settings.solver, candidates=count, initial_iterations=each)
    return replace(settings, obstacles=obstacles, initial_guess=guess, solver=solver)


def _two_steps(law: GuidanceLaw, preset: Preset, count: int) -> tuple[float, float]:
    """Computing times of the first two control steps [us]."""
    settings, pose = preset.settings, preset.pose
    law.reset()
    with collector_off():
        began = time.perf_counter_ns()
        decision = law.step(Observation(0, pose))
        first = time.perf_counter_ns() - began
        if decision is None:
            raise BenchError('plans: found no decision on the first odometry')
        held = np.array([settings.control_period])
        pose = settings.robot.roll_out(pose, decision.wheel_speeds[None], held)[-1]
        began = time.perf_counter_ns()
        decision = law.step(Observation(to_nanoseconds(settings.control_period), pose))
        second = time.perf_counter_ns() - began
    if count > 1 and (decision is None or f'best of {count} plans' not in decision.reason):
        found = None if decision is None else decision.reason
        raise BenchError(f'plans: found {found!r}, wanted the best of {count} plans')
    return first * 1e-3, second * 1e-3


OBSTACLE_COUNTS = (0, 1, 2, 4, 8, 16, 32, 64)

_ASIDE = 0.75  # offset of each from the centre line, to either side in turn [m]

_RADIUS = 0.2
_SPEED = 0.1
# Bearings of the first and the last from the road's centre; case 3 goes from -90 to 0 degrees.
_BEARINGS = (math.radians(-72.0), math.radians(-6.0))


@dataclass(frozen=True)
class ObstaclesTiming:
    """Medians of control steps past so many obstacles that stand, or move along the road [us].

    The longest first step where they stand looks for ways between them.
    """

    count: int
    standing: float
    moving: float
    first: float


def measure_obstacles(
    runs: int, counts: Sequence[int] = OBSTACLE_COUNTS, progress: Callable[[], None] = lambda: None
) -> list[ObstaclesTiming]:
    """Drive case 3's road past obstacles on both sides, all numbers of them in turn."""
    preset = Preset.load('case3')
    steps = {
        (count, moving): partial(_obstacle_step_times, preset, count, moving=moving)
        for count in counts
        for moving in (False, True)
    }
    in_turn(steps, 1, progress)
    times = in_turn(steps, runs, progress)
    return [
        ObstaclesTiming(
            count,
            float(np.median(np.concatenate(times[count, False]))),
            float(np.median(np.concatenate(times[count, True]))),
            max(float(steps[0]) for steps in times[count, False]),
        )
        for count in counts
    ]


def obstacles_table(found: Sequence[ObstaclesTiming]) -> Table:
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


def _obstacle_settings(settings: GuidanceSettings, count: int, *, moving: bool) -> GuidanceSettings:
    if moving:
        room = MovingObstacles(capacity=count, growth=0.0)
        return replace(settings, obstacles=(), moving_obstacles=room)
    discs = (
        Obstacle(str(k), (radius * math.cos(bearing), radius * math.sin(bearing)), _RADIUS)
        for k, (bearing, radius) in enumerate(_places(count))
    )
    return replace(settings, obstacles=tuple(discs))


def _obstacle_step_times(preset: Preset, count: int, *, moving: bool) -> Array:
    """Computing time of each control step of one run, waiting for a processor left out [us]."""
    settings = _obstacle_settings(preset.settings, count, moving=moving)
    tracks = partial(tracks_of_some, count if moving else 0)
    return 1e3 * step_times(settings, preset.pose, time.thread_time_ns, tracks)


FIELDS: Final = 'fields'  # of the study, instead of a preset
SENSOR_PRESETS = ('unknown', 'clutter', FIELDS, PRESET)
_FIELDS: Final = Study('clutter', seed=22, assignments=('goal.when=soonest',))
_MOST_FIELDS: Final = 12
_Drive: TypeAlias = tuple[GuidanceSettings, PlantSettings, Eyes, People | None]
_LONGEST: Final = 60 * 10**9  # time after which a drive among people ends [ns]


@dataclass(frozen=True)
class SensorsTiming:
    """Control steps of one preset, or across the fields of a study; all times [ms]."""

    name: str  # name of the preset
    # Time from odometry to the decision, with the newest scan and the distance field of the grid.
    step: Spread
    # To take in the newest scan, which here comes with the odometry that is decided on; in most
    # steps of a robot it has come before.
    scan: Spread
    field: Spread  # the distance field alone
    search: Spread  # the search of the grid, after the command
    after: Spread  # all that is done after the command, a search in it


def measure_sensors(
    runs: int, presets: Sequence[str] = SENSOR_PRESETS, progress: Callable[[], None] = lambda: None
) -> list[SensorsTiming]:
    """Drive presets whose obstacles a scanner sees, or another field each time, in turn.

    In the preset with people there are more of them.
    """
    numbers = itertools.cycle(range(_MOST_FIELDS))
    steps = {each: partial(_sensor_steps, partial(_of_preset, each)) for each in presets}
    if FIELDS in presets:
        steps[FIELDS] = partial(_sensor_steps, lambda: _of_field(next(numbers)))
    if PRESET in presets:
        steps[PRESET] = partial(_sensor_steps, among_people)
    in_turn(steps, 1, progress)
    found = []
    for name, runs_of in in_turn(steps, runs, progress).items():
        parts = np.concatenate(runs_of).T
        found.append(SensorsTiming(name, *map(Spread.of, parts)))
    return found


def _of_preset(preset: str) -> _Drive:
    values = TABLE.resolve(load_parameter_file(preset))
    settings, of_plant = guidance_settings(values), plant_settings(values)
    return settings, of_plant, Eyes(settings, laser_settings(values), shapes_of(values)), None


def _of_field(number: int) -> _Drive:
    task = _FIELDS.run(number)
    eyes = task.eyes(None)
    if eyes is None:
        raise BenchError('fields: found no scanner')
    return task.settings, task.plant, eyes, None


def _sensor_steps(begin: Callable[[], _Drive]) -> list[tuple[float, ...]]:
    """Times of each control step and its parts, as `SensorsTiming` [ms]."""
    settings, of_plant, eyes, people = begin()
    law, plant = GuidanceLaw(settings, settings.world), Plant(of_plant)
    steps: list[tuple[float, ...]] = []
    eyes.note(plant.motion)
    period = to_nanoseconds(1.0 / of_plant.odom_rate)
    with collector_off():
        while True:
            stamp, pose = plant.stamp_ns, plant.motion.pose
            if people is not None:
                people.begin(stamp)
                people.advance(stamp, pose[None, :2], settings.robot_radius)
            eyes.look(stamp)
            began = time.thread_time_ns()
            sighting = eyes.see(stamp, pose)
            seen = time.thread_time_ns()
            if law.is_due(stamp):
                tracks = () if sighting is None else sighting.tracks
                decision = law.step(Observation(stamp, pose, tracks, sighting))
                decided = time.thread_time_ns()
                if decision is None or decision.finished or sighting is None or stamp > _LONGEST:
                    return steps
                law.after_step()
                done = time.thread_time_ns()
                distance_field(sighting.grid, unknown_is_free=True)
                fielded = time.thread_time_ns()
                world = law.world.seeing(sighting.grid)
                search_ahead(settings, world, np.array(pose[:2]), [law.task.goals[-1].position])
                searched = time.thread_time_ns()
                times = np.diff([began, seen, decided, done, fielded, searched]) * 1e-6
                scan, step, after, field, search = times.tolist()
                steps.append((scan + step, scan, field, search, after))
                plant.command(stamp, *decision.twist.tolist())
            eyes.note(*plant.advance(stamp + period), plant.motion)


def sensors_table(found: Sequence[SensorsTiming]) -> Table:
    """Median, 99th percentile and largest times."""
    rows = [
        (
            each.name,
            *_tail(each.step),
            f'{each.scan.median:.2f}',
            f'{each.field.median:.2f}',
            *_tail(each.search)[:2],
            f'{each.after.median:.1f}',
            f'{each.after.largest:.1f}',
        )
        for each in found
    ]
    columns = (
        'preset', 'step', 'p99', 'max', 'scan', 'field', 'search', 'p99', 'after', 'max',
    )  # fmt: skip
    note = (
        'Computing times [ms]. The step includes the newest scan and the distance field of the '
        'grid; the search is one of the tasks after the command.'
    )
    return Table('Sensors', columns, rows, note)


def _tail(spread: Spread) -> list[str]:
    values = spread.median, spread.p99, spread.largest
    return ['–' if each is None else f'{each:.1f}' for each in values]
