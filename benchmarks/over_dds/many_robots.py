"""Many robots on one machine: each a simulator and a guidance node, in real time."""

import os
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.common import BenchError, Table, collector_off, processor_time, resident
from cmpsp_ros.arrays import Array
from cmpsp_ros.bags import DecisionRecord
from cmpsp_ros.demo import Child, DemoError, Scenario, guide, load_scenario, started
from cmpsp_ros.nodes import GuidanceStatus
from cmpsp_ros.parameters.files import write_fleet_file

_PRESET: Final = 'case3'
# Less odometry than by default: what costs time here is to send and hear messages.
_CHANGES: Final = ('odom_rate=20.0', 'final_time=15.0')

# Time between two that set out [s]: a first step, and what goes before it, takes the longest.
_APART: Final = 0.5

_KINDS: Final = ('guidance_node', 'sim_node')


@dataclass(frozen=True)
class ProcessKind:
    """The processes of one kind."""

    name: str  # their module
    memory: float  # resident set of the largest [MB]
    cpu: float  # mean load of a core while the robots drove


@dataclass(frozen=True)
class Crowd:
    """A number of robots, each alone on its road, on one machine at once."""

    robots: int  # number of robots
    start_up: float  # time from the first process to the last node that is configured [s]
    instants: int  # control instants of all robots
    skipped: int  # number of them without a decision
    late: int  # missed deadlines, as in doc/user/behaviour.md
    stops: int  # number of stops by a node for lack of odometry
    # Time from the stamp of odometry to the arrival of its decision ``(D,)`` [s]: by the one
    # process that listens to all.
    delays: Array
    own: Array  # time that each took in its node ``(D,)`` [s]
    miss: float  # greatest distance from the goal at the final time [m]
    kinds: tuple[ProcessKind, ...]  # the processes


def measure(count: int, progress: Callable[[float], None] = lambda _: None) -> Crowd:
    """Drive case 3 with a number of robots at once, in real time.

    Args:
        count: Number of robots.
        progress: Called with the time of the run so far [s].
    """
    alone = load_scenario(_PRESET, _CHANGES, lockstep=False)
    robots = [replace(alone, namespace=f'/r{number}') for number in range(1, count + 1)]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder)
        write_fleet_file(path / 'parameters.yaml', {each.namespace: each.values for each in robots})
        try:
            return _run(robots, path, progress)
        except DemoError as error:
            raise BenchError(f'{count} robots: {error}') from error


def table(crowd: Crowd) -> Table:
    """Table of the measurements."""
    delays, own = (np.percentile(each, [50, 99, 100]) * 1e3 for each in (crowd.delays, crowd.own))
    rows = [
        ['start-up', f'{crowd.start_up:.0f} s'],
        ['control instants', str(crowd.instants)],
        ['without a decision', str(crowd.skipped)],
        ['deadlines missed', str(crowd.late)],
        ['stops without odometry', str(crowd.stops)],
        ['odometry to decision heard, p50 / p99 / max', _times(delays)],
        ['in the node, p50 / p99 / max', _times(own)],
        ['largest miss of a goal', f'{crowd.miss:.3g} m'],
    ]
    for each in crowd.kinds:
        rows += [
            [f'memory of the largest {each.name}', f'{each.memory:.0f} MB'],
            [f'part of a core for one {each.name}', f'{100.0 * each.cpu:.1f} %'],
        ]
    whole = sum(each.cpu for each in crowd.kinds) * crowd.robots
    rows.append([f'cores at work, of {os.cpu_count()}', f'{whole:.2f}'])
    return Table(f'{crowd.robots} robots', ['figure', 'value'], rows)


def _run(robots: Sequence[Scenario], folder: Path, progress: Callable[[float], None]) -> Crowd:
    delays: list[float] = []
    own: list[float] = []
    late: list[bool] = []
    stops: list[str] = []
    ends: dict[str, tuple[int, float]] = {}

    def notice(robot: Scenario, seen: GuidanceStatus) -> None:
        decision = seen.decision
        if decision['finished'] == 'true':
            ends.setdefault(
                robot.namespace, (int(decision['step']), float(decision['terminal_error']))
            )
            return
        if decision['halted'] == 'true':
            stops.append(seen.reason)
            return
        settings = robot.settings
        record = DecisionRecord(robot.namespace, 0, seen.reason, decision)
        late.append(record.misses_deadline(settings.control_period, settings.command_delay))
        delays.append(time.time() - int(decision['stamp']) / 1e9)
        own.append(float(decision['step_ms']) / 1e3)
        progress(settings.final_time - float(decision['time_left']))

    begun = time.monotonic()
    # This process hears all robots, and must not hear them late.
    with collector_off(), started(robots, folder, record=False) as (observer, children):
        ready = time.monotonic()
        before = [processor_time(each.process.pid) for each in children]
        guide(observer, children, robots, notice, _APART)
        seconds = time.monotonic() - ready
        spent = [
            processor_time(each.process.pid) - used
            for each, used in zip(children, before, strict=True)
        ]
        kinds = tuple(_kind(name, children, spent, seconds) for name in _KINDS)
    settings = robots[0].settings
    instants = round(settings.final_time / settings.control_period)
    return Crowd(
        len(robots),
        ready - begun,
        instants * len(robots),
        sum(instants - steps for steps, _ in ends.values()),
        sum(late),
        len(stops),
        np.array(delays),
        np.array(own),
        max(miss for _, miss in ends.values()),
        kinds,
    )


def _kind(
    name: str, children: Sequence[Child], spent: Sequence[float], seconds: float
) -> ProcessKind:
    these = [i for i, each in enumerate(children) if each.name.endswith(name)]
    memory = max(resident(children[i].process.pid) for i in these)
    return ProcessKind(name, memory, float(np.mean([spent[i] for i in these])) / seconds)


def _times(milliseconds: Array) -> str:
    return ' / '.join(f'{each:.1f}' for each in milliseconds.tolist()) + ' ms'
