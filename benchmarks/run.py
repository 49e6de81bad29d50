"""The whole benchmark, part after part."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from benchmarks import drives
from benchmarks.common import BenchError, machine, resident
from benchmarks.crowds import PLAN_COUNTS, measure_plans
from benchmarks.general import time_programs
from benchmarks.horizons import grow, time_long_horizons
from benchmarks.loops import compare, hard_cases, loops, tails, time_hard_cases
from benchmarks.methods.ours import OURS, Method
from benchmarks.methods.peers import peers
from benchmarks.report import check_output, write
from benchmarks.results import Order, Results
from benchmarks.task import Task

if TYPE_CHECKING:
    from benchmarks.over_dds.latency import Latency

_LATENCY_RUNS = 3  # runs in real time, ten seconds each: enough for a 99th percentile

_PLAN_RUNS = 10  # runs of two steps each, for every run of a preset

# Called with a part of the work and its number of pieces; its result is called after each.
Progress = Callable[[str, int], Callable[[], None]]


def run(order: Order, progress: Progress = lambda _part, _pieces: lambda: None) -> Results:
    """Make the ordered measurements, and write the output."""
    presets = drives.chosen(order.presets)
    if order.output is not None:
        check_output(order.output)
    found, runs = machine(), order.runs
    # Measurements that need other processes come first, so that their failures show soon.
    latency = _latency(order, progress) if order.latency else None
    robots, models = drives.of_robots(order.robots), drives.of_models()
    of_robots = drives.time_robots(robots, runs, progress('robots', runs * len(robots)))
    of_models = drives.time_robots(models, runs, progress('models', runs * len(models)))
    told = progress('long horizons', len(order.long_horizons))
    long = time_long_horizons(order.long_horizons, runs, beside=order.peers, progress=told)
    timings = drives.time_presets(presets, runs, progress('presets', runs * len(presets)))
    cases = hard_cases()
    hard = time_hard_cases(cases, runs, progress('hard cases', runs * len(cases)))
    many = _PLAN_RUNS * runs
    told = progress('plans', (many + 1) * len(PLAN_COUNTS))
    plans = measure_plans(many, progress=told)
    task = Task.case3()
    ours: list[Method] = [make(task) for make in OURS]
    others, missing = peers(task) if order.peers else ([], {})
    methods = [*ours, *others]
    told = progress('methods', (runs + 1) * len(methods))
    comparison = compare(task, methods, order.steps, runs, told)
    timed = {each.name for each in comparison.timed}
    driving = [method for method in ours[1:] if method.name in timed]
    told = progress('tail', 2 * len(driving) * loops(order.tail, order.steps))
    of_tails = tails(task, driving, order.steps, order.tail, told)
    able = [method for method in methods if method.name in timed]
    told = progress('horizons', len(order.horizons))
    results = Results(
        order=order,
        machine=found,
        robots=of_robots,
        models=of_models,
        long_horizons=long,
        presets=timings,
        comparison=comparison,
        tails=of_tails,
        hard=hard,
        plans=plans,
        growth=grow(task, able, order.horizons, runs, told),
        general=time_programs(runs, progress('other sizes', runs)),
        missing=missing,
        latency=latency,
        resident=resident(),
    )
    if order.output is not None:
        write(results, order.output)
    return results


def _latency(order: Order, progress: Progress) -> Latency:
    try:
        from benchmarks.over_dds.latency import measure_latency  # noqa: PLC0415 (needs ROS)
    except ImportError as error:
        text = f'latency: found no ROS ({error}), wanted rclpy and the messages'
        raise BenchError(text) from error
    runs = min(order.runs, _LATENCY_RUNS)
    return measure_latency('case3', runs, progress('latency', runs))
