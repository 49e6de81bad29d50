"""From odometry to command through the real node, over DDS, in real time."""

import json
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.common import BenchError, Spread, resident
from cmpsp_ros.arrays import Array, BoolArray
from cmpsp_ros.demo import Child, DemoError, use_free_domain
from cmpsp_ros.nodes import LifecycleClient
from cmpsp_ros.parameters import TABLE, Values, load_parameter_file
from cmpsp_ros.parameters.files import write_parameter_file

_ACTIVE = '[guidance]: active'

_LOOK = 0.005
_START_TIMEOUT = 30.0
_COMPILE_TIMEOUT = 600.0
_OVERTIME = 20.0


@dataclass(frozen=True)
class Latency:
    """Measurements of some runs of one preset."""

    runs: int  # number of runs
    # Time from just before odometry is published to the callback with its command, of every control
    # step [ms].
    total: Array
    # Part of it from the guidance node's callback to its publishing, by its own clock [ms].
    own: Array
    # True for the first step of each run, at rest and without a previous plan, shape of `total`.
    first: BoolArray
    jitter: Array  # change of the total from one control step of a run to the next [ms]
    miss: float  # maximum distance from the goal at the final time, of all runs [m]
    # Time from the start of the guidance node's process to its activation, of each run; it is
    # configured and activated from outside as soon as it answers [s].
    starts: Array
    resident_active: float  # resident set of the guidance node when it becomes active [MB]
    resident_end: float  # the same at the end of the last run [MB]

    @property
    def under_way(self) -> Spread:
        """The total, but for first steps [ms]."""
        return Spread.of(self.total[~self.first])

    @property
    def rest(self) -> Spread:
        """Time outside of the node: middleware, executor, scheduler [ms]."""
        return Spread.of(self.total - self.own)


def measure_latency(preset: str, runs: int, progress: Callable[[], None] = lambda: None) -> Latency:
    """Drive a preset in real time repeatedly, with two processes, and take the times."""
    # Answers say which odometry they answer, and nobody begins before the other listens.
    changes = {'enable_stamped_cmd_vel': True, 'autostart': False}
    values = TABLE.resolve(load_parameter_file(preset) | changes)
    done = []
    for _ in range(runs):
        with tempfile.TemporaryDirectory() as folder:
            try:
                done.append(_run(values, Path(folder)))
            except (DemoError, TimeoutError) as error:
                raise BenchError(f'latency: {error}') from error
        progress()
    return Latency(
        runs,
        np.concatenate([each.total for each in done]),
        np.concatenate([each.own for each in done]),
        np.concatenate([each.first for each in done]),
        np.concatenate([each.jitter for each in done]),
        max(each.miss for each in done),
        np.concatenate([each.starts for each in done]),
        done[-1].resident_active,
        done[-1].resident_end,
    )


def _run(values: Values, folder: Path) -> Latency:
    parameters, output = folder / 'parameters.yaml', folder / 'latency.json'
    write_parameter_file(parameters, values)
    children: list[Child] = []
    with LifecycleClient(use_free_domain()) as observer:
        try:
            arguments = ['-p', f'parameters:={parameters}', '-p', f'output:={output}']
            children.append(Child.start('benchmarks.over_dds.latency_probe', arguments, folder))
            children.append(
                Child.start('guidance_node', ['--params-file', str(parameters)], folder)
            )
            _activate(observer, children)
            guidance = children[-1].process.pid
            at_first = resident(guidance)
            limit = _OVERTIME + values['final_time']
            if not observer.wait_until(lambda: _alive(children) and output.exists(), limit):
                raise BenchError(f'latency: found no end of the run within {limit:g} s')
            at_last = resident(guidance)
        finally:
            for child in reversed(children):
                child.stop()
    found = json.loads(output.read_text(encoding='utf-8'))
    total, own = np.array(found['total_ms']), np.array(found['own_ms'])
    first = np.arange(len(total)) == 0
    starts = np.array([_start_up(values, folder)])
    jitter = np.diff(total)
    return Latency(1, total, own, first, jitter, found['miss_m'], starts, at_first, at_last)


def _start_up(values: Values, folder: Path) -> float:
    """Time from the start of a guidance node's process until it logs that it is active [s].

    How soon others hear of it is the middleware's affair.
    """
    parameters = folder / 'start.yaml'
    write_parameter_file(parameters, values | {'autostart': True})
    use_free_domain()
    began = time.monotonic()
    child = Child.start('guidance_node', ['--params-file', str(parameters)], folder)
    try:
        while _ACTIVE not in child.log.read_text(errors='replace'):
            child.check()
            if time.monotonic() - began > _START_TIMEOUT:
                raise BenchError(f'latency: guidance_node is not active:\n{child.last_words()}')
            time.sleep(_LOOK)
        return time.monotonic() - began
    finally:
        child.stop()


def _activate(observer: LifecycleClient, children: list[Child]) -> None:
    """Activate the guidance node once the probe hears its commands."""

    def is_heard() -> bool:
        return _alive(children) and int(observer.seen.health.get('command_subscribers', 0)) > 0

    # It compiles when nobody has done so before.
    if not observer.configure(_COMPILE_TIMEOUT):
        raise BenchError(f'latency: guidance_node refuses to start:\n{children[-1].last_words()}')
    if not observer.wait_until(is_heard, _START_TIMEOUT):
        raise BenchError(f'latency: the nodes did not find each other in {_START_TIMEOUT:g} s')
    if not observer.activate(_START_TIMEOUT):
        raise BenchError('latency: guidance_node could not be activated')


def _alive(children: list[Child]) -> bool:
    for child in children:
        child.check()
    return True
