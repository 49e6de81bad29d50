"""Time of a live change and of the control step after it, beside that of a normal step.

`python -m benchmarks.live_changes` changes a weight, moves an obstacle, adds one, and brings new
costmaps, in turn, and prints the ratios.
"""

import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from benchmarks.common import collector_off
from benchmarks.drives import Preset
from cmpsp_ros.guidance import GuidanceLaw, GuidanceSettings, Observation, to_nanoseconds
from cmpsp_ros.world.grids import GridObstacle, OccupancyGrid
from cmpsp_ros.world.obstacles import Obstacle

_PRESETS = 'case3', 'corridor'
_WARM, _CHANGES = 6, 15
_FAR = (-60.0, -40.0, 0.0)
_SIDE, _CELL, _FULL = 200, 0.05, 0.02


def _weight(settings: GuidanceSettings, k: int) -> GuidanceSettings:
    weights = replace(settings.weights, road_center=settings.weights.road_center + 0.1 * k)
    return replace(settings, weights=weights)


def _moved(settings: GuidanceSettings, k: int) -> GuidanceSettings:
    other = Obstacle('other', (_FAR[0] + 0.01 * k, _FAR[1]), 0.1)
    return replace(settings, obstacles=(*settings.obstacles, other))


def _added(settings: GuidanceSettings, k: int) -> GuidanceSettings:
    others = (Obstacle(f'other {i}', (_FAR[0] + i, _FAR[1]), 0.1) for i in range(k + 1))
    return replace(settings, obstacles=(*settings.obstacles, *others))


def _costmap(settings: GuidanceSettings, k: int) -> GuidanceSettings:
    cells = (np.random.default_rng(k).random((_SIDE, _SIDE)) < _FULL).astype(np.uint8)
    known = GridObstacle('map', OccupancyGrid(_FAR, _CELL, cells), unknown_is_free=True)
    # The parameters are checked with it, before the law has it.
    known.check_space()
    return replace(settings, obstacles=(*settings.obstacles, known))


_Change = Callable[[GuidanceSettings, int], GuidanceSettings]

CHANGES: dict[str, _Change] = {
    'weight': _weight,
    'obstacle moved': _moved,
    'obstacle added': _added,
    'costmap': _costmap,
}


def measure(preset: Preset, change: _Change) -> list[float]:
    """Medians of a normal step, of a live change, and of the step after it [ms]."""
    settings, pose = preset.settings, preset.pose
    law = GuidanceLaw(settings, settings.world)
    held = np.array([settings.control_period])

    def steps() -> Iterator[float]:
        nonlocal pose
        stamp, period = 0, to_nanoseconds(settings.control_period)
        while True:
            began = time.perf_counter()
            decision = law.step(Observation(stamp, pose))
            yield 1e3 * (time.perf_counter() - began)
            law.after_step()
            wheels = np.zeros((1, 2)) if decision is None else decision.wheel_speeds[None]
            pose = settings.robot.roll_out(pose, wheels, held)[-1]
            stamp += period

    step, times = steps(), []
    with collector_off():
        for k in range(-_WARM, _CHANGES):
            normal = next(step)
            if k < 0:
                continue
            changed = change(settings, k)
            began = time.perf_counter()
            law.reconfigure(changed, changed.world)
            took = 1e3 * (time.perf_counter() - began)
            times.append((normal, took, next(step)))
    medians: list[float] = np.median(times, axis=0).tolist()
    return medians


def main() -> None:
    """Print a line for each preset and change."""
    for preset in _PRESETS:
        for name, change in CHANGES.items():
            normal, took, after = measure(Preset.load(preset), change)
            sys.stdout.write(
                f'{preset}, {name}: a step takes {normal:.2f} ms, the change {took / normal:.1f}'
                f' times as long, the step after it {after / normal:.1f} times\n'
            )


if __name__ == '__main__':
    main()
