"""Results as tables."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from benchmarks.families.general import PROGRAMS
from benchmarks.families.long_horizons import COLD, LIMIT, QP_PEERS, WARM
from benchmarks.families.robot_drives import PRESET
from benchmarks.families.spread import Spread
from benchmarks.families.timing import Ratios
from benchmarks.results import Results
from benchmarks.table import Table
from benchmarks.targets import PIQP, PIQP_THERE, Target, pace, targets

if TYPE_CHECKING:
    from benchmarks.over_dds.latency import Latency

_NONE = '–'


def tables(results: Results) -> Iterator[Table]:
    """All tables of some results."""
    yield _targets(results)
    yield _robots(results)
    yield _long_horizons(results)
    if any(each.ratios for each in results.long_horizons.found):
        yield _beside(results)
    yield _presets(results)
    yield _hard(results)
    yield _comparison(results)
    yield _outcomes(results)
    yield _tails(results)
    yield _plans(results)
    yield _growth(results)
    yield _general(results)
    left_out = results.comparison.left_out | results.missing | results.long_horizons.missing
    if left_out:
        yield Table('Not compared', ('method', 'why'), list(left_out.items()), words=2)
    if results.latency is not None:
        yield _latency(results.latency)
    yield _memory(results)


def _targets(results: Results) -> Table:
    rows = [
        (each.what, f'{each.at_most:g}', _of(each.found, 3), _verdict(each))
        for each in targets(results)
    ]
    note = (
        'What this run has found beside what the project has set out to reach. Quotients are'
        ' medians of those in the same step of the same run.'
    )
    if slower := pace(results):
        note += (
            f' Targets in milliseconds are for a machine on which *{PIQP}* takes {PIQP_THERE} ms a'
            f' step of Case 3: this one takes {slower:.2f} times as long.'
        )
    return Table('Targets', ('what', 'at most', 'found', 'holds'), rows, note)


def _verdict(target: Target) -> str:
    if target.holds is None:
        return 'not measured'
    return 'yes' if target.holds else 'no'


def _robots(results: Results) -> Table:
    note = (
        f'Each robot of `config/robots` that fits on `{PRESET}`, in lockstep: all that the'
        ' guidance law does in a control step, on a horizon of so many steps that shrinks.'
        ' Computing time, waiting for a processor left out. *First* is the median of the first'
        ' steps, in which the robot stands and plans are made from nothing; *max* is that of all'
        ' later ones. *Work* is that of the step that does the most, in visits of a stage, and'
        ' of the most after the first. The last ones are the robot of case 3 and a car as fast as'
        ' it, on that course.'
    )
    rows = []
    for each in (*results.robots, *results.models):
        later = each.times[:, 1:]
        rows.append(
            (
                each.name,
                str(each.times.shape[1]),
                _of(float(np.median(each.times[:, 0])), 1),
                *_spread(Spread.of(each.times), 2)[:2],
                _of(float(later.max()), 1),
                str(each.work.max()),
                str(each.work[1:].max()),
                ', '.join(f'{level} {count}' for level, count in each.levels.items()),
                f'{each.terminal_error:.1e}',
            )
        )
    columns = (
        'robot', 'steps', 'first', 'median', 'p99', 'max', 'work', 'work after the first',
        'fallback level', 'terminal error [m]',
    )  # fmt: skip
    return Table('Robots on long horizons [ms]', columns, rows, note)


def _long_horizons(results: Results) -> Table:
    found = results.long_horizons
    warm, cold = found.exponent(WARM), found.exponent(COLD)
    rows = [
        (
            str(each.steps),
            f'{100.0 * each.active:.0f} %',
            _of(each.times[WARM], 0),
            _of(each.times[COLD], 0),
            f'{each.qp_iterations:g}',
            f'{each.work:g}',
        )
        for each in found.found
    ]
    rows.append(('exponent of N', '', _of(warm, 2), _of(cold, 2), '', ''))
    columns = ('N', 'bounds active', 'warm [µs]', 'cold [µs]', 'QP iterations', 'work')
    note = (
        f'Case 3 with a wheel-speed limit of {LIMIT:g} rad/s, cut into N control periods: the outer'
        ' wheel turns at the limit nearly all the way. One plan, improved by two iterations with'
        ' line search from a pose a few millimetres beside its own; computing time. *Bounds active*'
        ' are those with a multiplier, of two for each step. *Warm* begins with the active'
        ' constraints of the plan, as a control step does, *cold* with none.'
    )
    return Table('One plan over long horizons', columns, rows, note)


def _beside(results: Results) -> Table:
    found = results.long_horizons
    rows = []
    for name in QP_PEERS:
        able = [each for each in found.found if name in each.ratios]
        for each in able:
            ratios = (_of(ratio, 3) for ratio in each.ratios[name])
            rows.append((name, str(each.steps), _of(each.times[name], 0), *ratios))
        if able:
            rows.append((name, 'exponent of N', _of(found.exponent(name), 2), '', ''))
    columns = ('method', 'N', 'time [µs]', 'ratio', 'ratio to its programs alone')
    note = (
        'The same steps by two iterations of other solvers, through CasADi, in turn with ours.'
        ' Ratios are medians of quotients of the *warm* step of the table above by theirs of the'
        ' same step, and by the time of their quadratic programs alone, without derivatives: ours'
        ' has the line search in it as well. Only steps that reach the goal and keep clear count.'
    )
    return Table('Other solvers over long horizons', columns, rows, note)


def _presets(results: Results) -> Table:
    note = (
        'All that the guidance law does in a control step: warm start, two iterations with line'
        ' search, audit. *First* is the median of the first steps, which have the full horizon;'
        ' the columns after it are of every step. At the start, and where a plan has a flaw,'
        ' plans for other ways through the obstacles are made beside it.'
    )
    rows = [
        (each.name, _of(each.first.median, 3), *_spread(each.every, 3)) for each in results.presets
    ]
    columns = ('run', 'first', 'median', 'p99', 'p99.9', 'max')
    return Table('Control step of the guidance law [ms]', columns, rows, note)


def _hard(results: Results) -> Table:
    note = (
        'One plan, warm started, improved by two iterations with line search, audited and followed'
        ' to the end, in runs with many active rows and from the starts of Tables 1 and 2. From'
        ' most of these it needs slack, and never comes out of it: the guidance law would make'
        ' another one beside it. *Longest* is the median over the runs of that step for which it is'
        ' the greatest, *max* what any step of any run took.'
    )
    rows = [
        (
            each.name,
            str(each.elastic),
            _of(float(np.median(each.times[:, 0])), 3),
            _of(each.longest, 3),
            *_spread(Spread.of(each.times), 3),
        )
        for each in results.hard
    ]
    columns = ('run', 'steps with slack', 'first', 'longest', 'median', 'p99', 'p99.9', 'max')
    return Table('Full step, hard cases [ms]', columns, rows, note)


def _comparison(results: Results) -> Table:
    found = results.comparison
    rows = []
    for each in found.timed:
        ratios = Ratios.of(each.times, found.timed[0].times)
        times = _of(each.first.median, 0), f'{ratios.first:.3g}', *_spread(each.loop, 0)
        rows.append((each.name, *times, f'{ratios.loop:.3g}'))
    columns = ('method', 'first', 'ratio', 'median', 'p99', 'p99.9', 'max', 'ratio of all')
    note = (
        f'Case 3 with {found.steps} steps, {found.runs} closed loops of each method, the methods'
        ' in turn. *First* is the median of the first steps; the columns after *ratio* are of'
        ' every step of the shrinking horizon. Ratios are medians of quotients in the same step'
        f' of the same run, with *{found.timed[0].name}* below.'
    )
    return Table(f'Two iterations, {found.steps} steps [µs]', columns, rows, note)


def _outcomes(results: Results) -> Table:
    rows = [
        (each.name, f'{o.cost:.4f}', f'{o.miss:.1e}', f'{o.violation:+.1e}', f'{o.wheel_speed:.4f}')
        for each in results.comparison.timed
        for o in (each.outcome,)
    ]
    columns = ('method', 'cost', 'miss [m]', 'violation [m]', 'fastest wheel [rad/s]')
    note = (
        'Where the same closed loops lead, by the model of this package: a wrong problem would show'
        ' here. Only methods that reach the goal and keep clear are timed. *Violation* is the'
        ' largest at the samples, negative where there is room left.'
    )
    return Table('What the methods drive', columns, rows, note)


def _tails(results: Results) -> Table:
    rows = []
    for each in results.tails:
        for name, spread, ratio in (
            (each.name, each.spread, each.ratio),
            (f'{each.name}: first step', each.spread_again, each.ratio_again),
        ):
            rows.append((name, str(spread.count), *_spread(spread, 1), _of(ratio, 2)))
    columns = ('method', 'steps', 'median', 'p99', 'p99.9', 'max', 'p99.9 / median')
    note = (
        f'Closed loops of {results.comparison.steps} steps in this process, the methods in turn,'
        ' with what exists frozen and the garbage collector off, as in the guidance node. The'
        ' first steps, with the full horizon, are among the longest: so the first step is made'
        ' again and again as well, which shows how much one and the same step varies.'
    )
    return Table('Longest control steps [µs]', columns, rows, note)


def _plans(results: Results) -> Table:
    alone = results.plans[0]
    rows = []
    for each in results.plans:
        second = Spread.of(each.second)
        ratio = float(np.median(each.second / alone.second))
        first = _of(float(np.median(each.first)), 0)
        rows.append((str(each.count), first, *_spread(second, 0), _of(ratio, 2)))
    columns = ('plans', 'first', 'median', 'p99', 'p99.9', 'max', 'ratio')
    note = (
        f'{len(alone.first)} times the first two control steps of Case 3 past four small obstacles'
        ' on the centre line, with all that the guidance law does, two iterations of each plan. The'
        ' *first* step looks for the ways as well; the columns after it are of the second, with as'
        ' many plans. Ratios are medians of quotients of second steps that followed each other.'
    )
    return Table('Plans side by side [µs]', columns, rows, note)


def _growth(results: Results) -> Table:
    horizons = list(results.order.horizons)
    rows = []
    for each in results.growth:
        times = dict(zip(each.steps, each.times, strict=True))
        exponent = _NONE if each.exponent is None else f'{each.exponent:.2f}'
        cells = (_of(times.get(steps), 0) for steps in horizons)
        rows.append((each.name, *cells, exponent))
    columns = ('method', *(f'N = {steps}' for steps in horizons), 'exponent')
    note = (
        'Case 3 cut into N steps, from the same guess. The exponent is that of N, fitted from 100'
        ' steps on. Slow methods are not asked for long horizons. The full step and the guidance'
        ' law keep clear between samples: with few steps there is no room for that.'
    )
    return Table('First step over horizons [µs]', columns, rows, note)


def _general(results: Results) -> Table:
    base = results.general[0]
    rows = [
        (
            f'{each.states}, {each.controls}',
            f'{each.iterations:g}',
            f'{each.active:g}',
            _of(each.time, 0),
            _of(each.time / base.time, 2),
            _of(each.flops / base.flops, 2),
            _of(each.flops / each.time * 1e-3, 2),
        )
        for each in results.general
    ]
    columns = (
        'states, controls', 'iterations', 'active rows', 'time [µs]', 'ratio', 'ratio of work',
        'GFLOP/s',
    )  # fmt: skip
    note = (
        f'{PROGRAMS} random programs of 50 steps for each size, through the back end for any'
        ' problem, which fills a program up to the next size it is compiled for (8, 4 for 6, 2 and'
        ' 16, 8 for 12, 4): the time is that of the larger size. The work is that of one'
        ' factorisation and as many iterations as were made, by count of their operations. Active'
        ' rows include bounds that are held in the factorisation.'
    )
    return Table('One program of other sizes', columns, rows, note)


def _latency(found: Latency) -> Table:
    total, own = Spread.of(found.total), Spread.of(found.own)
    rows = [
        (name, *_spread(spread, 2))
        for name, spread in (
            ('odometry to command', total),
            ('of that the node itself', own),
            ('of that the rest', found.rest),
            ('odometry to command, first steps aside', found.under_way),
            ('from the start of the process to an active node', Spread.of(found.starts * 1e3)),
        )
    ]
    columns = ('', 'median', 'p99', 'p99.9', 'max')
    note = (
        f'{found.runs} runs of Case 3 in real time, {total.count} control steps: from just before'
        ' the odometry is published by one process to the callback with the command in the same,'
        ' the node in another. *The node itself* is from its callback to its publishing, by its'
        ' own clock: the command may be heard before that has returned. In the first step of a run'
        ' the robot stands, and plans are made from nothing.'
        f' The goal was missed by {found.miss * 1e3:.1f} mm at most: the command comes'
        ' later than the odometry that it answers.'
    )
    return Table('Latency over DDS [ms]', columns, rows, note)


def _memory(results: Results) -> Table:
    rows = [('this benchmark, at its end', f'{results.resident:.0f}')]
    found = results.latency
    if found is not None:
        rows = [
            ('guidance node, when it becomes active', f'{found.resident_active:.0f}'),
            ('guidance node, at the end of a run', f'{found.resident_end:.0f}'),
            *rows,
        ]
    return Table('Resident memory [MB]', ('process', 'resident'), rows)


def _spread(spread: Spread, digits: int) -> tuple[str, ...]:
    values = (spread.median, spread.p99, spread.p999, spread.largest)
    return tuple(_of(value, digits) for value in values)


def _of(value: float | None, digits: int) -> str:
    return _NONE if value is None else f'{value:.{digits}f}'
