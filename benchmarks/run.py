"""The whole benchmark, part after part."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from benchmarks.errors import BenchError
from benchmarks.families import (
    general,
    hard_cases,
    long_horizons,
    many_plans,
    presets,
    robot_drives,
)
from benchmarks.families.horizons import grow
from benchmarks.families.tail import loops, tails
from benchmarks.families.task import Task
from benchmarks.families.timing import compare
from benchmarks.machine import machine, resident
from benchmarks.methods.method import Method
from benchmarks.methods.ours import OURS
from benchmarks.methods.peers import peers
from benchmarks.report import check_output, write
from benchmarks.results import Order, Results

if TYPE_CHECKING:
    from benchmarks.over_dds.latency import Latency

_LATENCY_RUNS = 3
"""Runs in real time, ten seconds each: enough for a 99th percentile."""

_PLAN_RUNS = 10
"""Of two steps each, for every run of a preset."""

Progress = Callable[[str, int], Callable[[], None]]
"""Told a part of the work and how many pieces it has; what it returns is called after each."""


def run(order: Order, progress: Progress = lambda _part, _pieces: lambda: None) -> Results:
    """Measure what is asked, and write it where it is asked.

    Raises:
        BenchError: The output cannot be used, or a measurement failed.
        ParameterError: No such preset, or one that cannot be used.
    """
    driven = presets.chosen(order.presets)
    if order.output is not None:
        check_output(order.output)
    found = machine()
    # First what needs more than this process, so that what fails there fails soon.
    latency = _latency(order, progress) if order.latency else None
    told = progress('robots', order.runs * len(order.robots))
    robots = robot_drives.measure(robot_drives.of_robots(order.robots), order.runs, told)
    models = robot_drives.of_models()
    told = progress('models', order.runs * len(models))
    of_models = robot_drives.measure(models, order.runs, told)
    told = progress('long horizons', len(order.long_horizons))
    long = long_horizons.measure(order.long_horizons, order.runs, beside=order.peers, progress=told)
    timings = presets.measure(driven, order.runs, progress('presets', order.runs * len(driven)))
    of_hard = hard_cases.presets()
    told = progress('hard cases', order.runs * len(of_hard))
    hard = hard_cases.measure(of_hard, order.runs, told)
    many = _PLAN_RUNS * order.runs
    of_plans = many_plans.measure(many, progress=progress('plans', many + 1))
    task = Task.case3()
    ours: list[Method] = [make(task) for make in OURS]
    others, missing = peers(task) if order.peers else ([], {})
    methods = [*ours, *others]
    told = progress('methods', (order.runs + 1) * len(methods))
    comparison = compare(task, methods, order.steps, order.runs, told)
    timed = {each.name for each in comparison.timed}
    driving = [method for method in ours[1:] if method.name in timed]
    told = progress('tail', loops(order.tail, order.steps))
    of_tails = tails(task, driving, order.steps, order.tail, told)
    able = [method for method in methods if method.name in timed]
    told = progress('horizons', len(order.horizons))
    results = Results(
        order=order,
        machine=found,
        robots=robots,
        models=of_models,
        long_horizons=long,
        presets=timings,
        comparison=comparison,
        tails=of_tails,
        hard=hard,
        plans=of_plans,
        growth=grow(task, able, order.horizons, order.runs, told),
        general=general.measure(order.runs, progress('other sizes', order.runs)),
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
        raise BenchError(
            f'latency: found no ROS ({error}), wanted rclpy and the messages'
        ) from error
    runs = min(order.runs, _LATENCY_RUNS)
    return measure_latency('case3', runs, progress('latency', runs))
