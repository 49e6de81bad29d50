"""Results as tables; titles, columns and notes are in `tables.toml`."""

import tomllib
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.common import Spread, Table
from benchmarks.drives import COURSE
from benchmarks.general import PROGRAMS
from benchmarks.horizons import COLD, LIMIT, QP_PEERS, WARM
from benchmarks.loops import Ratios
from benchmarks.results import PIQP, PIQP_THERE, Results, pace, targets

_NONE = '–'
_HOLDS = {None: 'not measured', True: 'yes', False: 'no'}

Rows = Iterator[Sequence[str]]


def tables(results: Results) -> Iterator[Table]:
    """All tables of some results."""
    loops, latency = results.comparison, results.latency
    machine = ''
    if slower := pace(results):
        text = _texts()['targets']['machine']
        machine = text.format(piqp=PIQP, there=PIQP_THERE, slower=slower)
    yield _table('targets', _targets(results), machine=machine)
    yield _table('robots', _robots(results), course=COURSE)
    yield _table('long_horizons', _long_horizons(results), limit=LIMIT)
    if any(each.ratios for each in results.long_horizons.found):
        yield _table('beside', _beside(results))
    yield _table('presets', _presets(results))
    yield _table('hard', _hard(results))
    baseline = loops.timed[0].name
    values: dict[str, Any] = {'steps': loops.steps, 'runs': loops.runs, 'baseline': baseline}
    yield _table('comparison', _comparison(results), **values)
    yield _table('outcomes', _outcomes(results))
    yield _table('tails', _tails(results), steps=loops.steps)
    yield _table('plans', _plans(results), runs=len(results.plans[0].first))
    horizons = [f'N = {steps}' for steps in results.order.horizons]
    yield _table('growth', _growth(results), [*horizons, 'exponent'])
    yield _table('general', _general(results), programs=PROGRAMS)
    if left_out := loops.left_out | results.missing | results.long_horizons.missing:
        yield _table('left_out', iter(left_out.items()), words=2)
    if latency is not None:
        steps, miss = latency.total.size, latency.miss * 1e3
        yield _table('latency', _latency(results), runs=latency.runs, steps=steps, miss=miss)
    yield _table('memory', _memory(results))


@cache
def _texts() -> dict[str, dict[str, Any]]:
    return tomllib.loads(Path(__file__).with_name('tables.toml').read_text(encoding='utf-8'))


def _table(
    key: str, rows: Rows, columns: Sequence[str] = (), words: int = 1, **values: Any
) -> Table:
    text = _texts()[key]
    title, note = (text[part].format_map(values) for part in ('title', 'note'))
    return Table(title, (*text['columns'], *columns), list(rows), note, words)


def _targets(results: Results) -> Rows:
    for each in targets(results):
        yield each.what, f'{each.at_most:g}', _of(each.found, 3), _HOLDS[each.holds]


def _robots(results: Results) -> Rows:
    for each in (*results.robots, *results.models):
        yield (
            each.name,
            str(each.times.shape[1]),
            _of(np.median(each.times[:, 0]), 1),
            *_spread(Spread.of(each.times), 2)[:2],
            _of(each.times[:, 1:].max(), 1),
            str(each.work.max()),
            str(each.work[1:].max()),
            ', '.join(f'{level} {count}' for level, count in each.levels.items()),
            f'{each.terminal_error:.1e}',
        )


def _long_horizons(results: Results) -> Rows:
    found = results.long_horizons
    for each in found.found:
        yield (
            str(each.steps),
            f'{100.0 * each.active:.0f} %',
            _of(each.times[WARM], 0),
            _of(each.times[COLD], 0),
            f'{each.qp_iterations:g}',
            f'{each.work:g}',
        )
    exponents = (_of(found.exponent(name), 2) for name in (WARM, COLD))
    yield 'exponent of N', '', *exponents, '', ''


def _beside(results: Results) -> Rows:
    found = results.long_horizons
    for name in QP_PEERS:
        able = [each for each in found.found if name in each.ratios]
        for each in able:
            ratios = (_of(ratio, 3) for ratio in each.ratios[name])
            yield name, str(each.steps), _of(each.times[name], 0), *ratios
        if able:
            yield name, 'exponent of N', _of(found.exponent(name), 2), '', ''


def _presets(results: Results) -> Rows:
    for each in results.presets:
        yield each.name, _of(each.first.median, 3), *_spread(each.every, 3)


def _hard(results: Results) -> Rows:
    for each in results.hard:
        first = _of(np.median(each.times[:, 0]), 3)
        spread = _spread(Spread.of(each.times), 3)
        yield each.name, str(each.elastic), first, _of(each.longest, 3), *spread


def _comparison(results: Results) -> Rows:
    timed = results.comparison.timed
    for each in timed:
        ratios = Ratios.of(each.times, timed[0].times)
        times = _of(each.first.median, 0), f'{ratios.first:.3g}', *_spread(each.loop, 0)
        yield each.name, *times, f'{ratios.loop:.3g}'


def _outcomes(results: Results) -> Rows:
    for each in results.comparison.timed:
        o = each.outcome
        figures = f'{o.cost:.4f}', f'{o.miss:.1e}', f'{o.violation:+.1e}', f'{o.wheel_speed:.4f}'
        yield each.name, *figures


def _tails(results: Results) -> Rows:
    for each in results.tails:
        for name, spread, ratio in (
            (each.name, each.spread, each.ratio),
            (f'{each.name}: first step', each.spread_again, each.ratio_again),
        ):
            yield name, str(spread.count), *_spread(spread, 1), _of(ratio, 2)


def _plans(results: Results) -> Rows:
    alone = results.plans[0]
    for each in results.plans:
        ratio = np.median(each.second / alone.second)
        spread = _spread(Spread.of(each.second), 0)
        yield str(each.count), _of(np.median(each.first), 0), *spread, _of(ratio, 2)


def _growth(results: Results) -> Rows:
    for each in results.growth:
        times = dict(zip(each.steps, each.times, strict=True))
        cells = (_of(times.get(steps), 0) for steps in results.order.horizons)
        yield each.name, *cells, _of(each.exponent, 2)


def _general(results: Results) -> Rows:
    base = results.general[0]
    for each in results.general:
        yield (
            f'{each.states}, {each.controls}',
            f'{each.iterations:g}',
            f'{each.active:g}',
            _of(each.time, 0),
            _of(each.time / base.time, 2),
            _of(each.flops / base.flops, 2),
            _of(each.flops / each.time * 1e-3, 2),
        )


def _latency(results: Results) -> Rows:
    found = results.latency
    if found is None:
        return
    for name, spread in (
        ('odometry to command', Spread.of(found.total)),
        ('in the node', Spread.of(found.own)),
        ('outside the node', found.rest),
        ('odometry to command, first steps aside', found.under_way),
        ('from the start of the process to an active node', Spread.of(found.starts * 1e3)),
    ):
        yield name, *_spread(spread, 2)


def _memory(results: Results) -> Rows:
    if (found := results.latency) is not None:
        yield 'guidance node, when it becomes active', f'{found.resident_active:.0f}'
        yield 'guidance node, at the end of a run', f'{found.resident_end:.0f}'
    yield 'this benchmark, at its end', f'{results.resident:.0f}'


def _spread(spread: Spread, digits: int) -> tuple[str, ...]:
    values = (spread.median, spread.p99, spread.p999, spread.largest)
    return tuple(_of(value, digits) for value in values)


def _of(value: float | None, digits: int) -> str:
    return _NONE if value is None else f'{value:.{digits}f}'
