"""A road followed round after round: does anything drift, or grow?

`python test/unit/guidance/endless.py --minutes 60` drives the preset `endless` for an hour of
simulated time, law and plant in this process, without and then with odometry that errs, and prints
a line every tenth of it. Exit code 1 if the mean speed changes, something is touched, or memory
grows.
"""

from __future__ import annotations

import argparse
import gc
import sys
import tracemalloc
from collections import Counter
from dataclasses import dataclass

import numpy as np

from cmpsp_ros.bags.runs import mean_speed
from cmpsp_ros.guidance import GuidanceLaw, Observation, to_nanoseconds
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file, plant_settings
from cmpsp_ros.simulator import Plant
from cmpsp_ros.world import FreeSpace

PARTS = 10
NOISE = {'noise.position_stddev': 0.003, 'noise.heading_stddev': 0.003}
GROWTH = 50_000
"""Memory that may be held at the end more than after the second tenth [bytes]."""


@dataclass(frozen=True)
class Part:
    """A tenth of a drive.

    Attributes:
        speed: Mean along the road [m/s].
        clearance: Least, between samples too [m].
        levels: Control steps on each.
        memory: Held by Python at its end [bytes].
    """

    speed: float
    clearance: float
    levels: Counter
    memory: int


def drive(minutes, changes=None):
    """Drive; yields the parts one after the other."""
    values = TABLE.resolve(
        load_parameter_file('endless') | {'final_time': 0.0, 'odom_rate': 5.0} | (changes or {})
    )
    settings, plant = guidance_settings(values), Plant(plant_settings(values))
    law, period = GuidanceLaw(settings, settings.world), to_nanoseconds(settings.control_period)
    space = FreeSpace.of(settings.road, settings.obstacles, settings.robot_radius)
    steps, stamp = round(minutes * 60.0 / settings.control_period / PARTS), 0
    tracemalloc.start()
    for _ in range(PARTS):
        poses, twists, levels = [plant.pose], [], Counter()
        for _ in range(steps):
            decision = law.step(Observation(stamp, plant.measure()))
            levels[decision.level.name.lower()] += 1
            plant.command(stamp, *decision.twist.tolist())
            stamp += period
            plant.advance(stamp)
            poses.append(plant.pose)
            twists.append(decision.twist)
        path, durations = np.array(poses), np.full(steps, settings.control_period)
        gc.collect()
        clearance = space.along(path[:-1], np.array(twists), durations).min()
        speed = mean_speed(settings, path, float(durations.sum()))
        yield Part(speed, float(clearance), levels, tracemalloc.get_traced_memory()[0])
    tracemalloc.stop()


def is_steady(parts, speed, tolerance=0.01):
    """True if the last part is as the second: as fast, as clear, and with no more memory."""
    after, last = parts[1], parts[-1]
    return (
        all(abs(part.speed - speed) < tolerance * speed for part in parts)
        and all(part.clearance >= 0.0 for part in parts)
        and not any(part.levels['previous_plan'] + part.levels['stop'] for part in parts)
        and last.memory - after.memory < GROWTH
    )


def main():
    """Drive twice and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--minutes', type=float, default=60.0)
    minutes, steady = parser.parse_args().minutes, True
    for name, changes in (('exact odometry', {}), ('odometry that errs by 3 mm', NOISE)):
        print(name)
        parts = []
        for number, part in enumerate(drive(minutes, changes), 1):
            parts.append(part)
            levels = ', '.join(f'{count} {level}' for level, count in part.levels.items())
            print(
                f'{number * minutes / PARTS:6.1f} min: {part.speed:.5f} m/s, clearance'
                f' {part.clearance:+.4f} m, {levels}, {part.memory / 1e3:.1f} kB'
            )
        steady &= is_steady(parts, 1.2)
    return 0 if steady else 1


if __name__ == '__main__':
    sys.exit(main())
