"""Checks of Fig. 5 with Theorem 2, and of the computing time."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from cmpsp_ros.studies.common import WIDTH, cpu_model
from cmpsp_ros.studies.paper.drives import guessed_path, run_law
from cmpsp_ros.studies.paper.experiments import FIG5_GUESSES, cases, table1
from cmpsp_ros.studies.paper.iterations import Conditions, Convergence, converge, measure_conditions
from cmpsp_ros.studies.paper.pictures import key_above
from cmpsp_ros.studies.paper.report import ClaimVerdict, Sheet, Table

_ITERATIONS = 100
_LONG = 300
_TAIL = (50, 100, 200)
_PAPER_MS = 150.0
_RUNS = 5


def fig5(sheet: Sheet) -> None:
    """Convergence with q = 0 from five guesses, and beside it with q = 15."""
    case1, _, case3 = cases()
    lab, guesses = sheet.lab, [guess for guess, _ in FIG5_GUESSES]
    lab.progress('iterating to convergence from five guesses')
    law = [converge(case1, guess, _ITERATIONS, road_center=0.0) for guess in guesses]
    full = [
        converge(case1, guess, _ITERATIONS, road_center=0.0, full_steps=True) for guess in guesses
    ]
    weight = case1.settings.weights.road_center
    lab.progress(f'iterating with q = {weight:g}')
    road = [converge(case1, guess, _LONG, road_center=weight) for guess in guesses]
    lab.progress('measuring the conditions of Theorem 2')
    measured = {
        each.key: measure_conditions(lab.drive(each, between_samples=False).path)
        for each in (case1, case3)
    }
    measured['table1_2, first guess'] = measure_conditions(guessed_path(table1()[1]))
    _rates(sheet, law, full, road)
    _theorem(sheet, *measured.values())
    sheet.figure = _draw(law, road)
    sheet.tables.append(_table(law, full, road))
    sheet.numbers |= {
        'q_0': [
            {
                'guess_rad_s': guess,
                'first_miss_m': one.first_miss,
                'errors_rad_s': one.errors.tolist(),
                'ratios': one.ratios.tolist(),
                'full_steps_converge': two.converged,
                'full_steps_last_miss_m': two.last_miss,
            }
            for guess, one, two in zip(guesses, law, full, strict=True)
        ],
        'q_15': [
            {'guess_rad_s': guess, 'changes_rad_s': each.changes.tolist()}
            for guess, each in zip(guesses, road, strict=True)
        ],
        'conditions': {key: vars(each) for key, each in measured.items()},
    }


def timing(sheet: Sheet) -> None:
    """Median and longest control step of Cases 1 to 3 on this machine."""
    for each in cases():
        sheet.lab.drive(each, between_samples=True)
    sheet.lab.progress('timing control steps')
    rounds = [
        [run_law(each, between_samples=True).step_times for each in cases()] for _ in range(_RUNS)
    ]
    steps = {
        each.label: np.concatenate(of_case)
        for each, of_case in zip(cases(), zip(*rounds, strict=True), strict=True)
    }
    medians = {name: float(np.median(each)) for name, each in steps.items()}
    longest = {name: float(each.max()) for name, each in steps.items()}
    median, cpu = medians['Case 3'], cpu_model()
    faster = _PAPER_MS / median
    values: dict[str, Any] = {
        'median': median,
        'longest': longest['Case 3'],
        'cpu': cpu,
        'faster': faster,
    }
    sheet.claim('timing_step', ClaimVerdict.UNDECIDABLE, **values)
    sheet.claim('timing_expected', median < _PAPER_MS / 2.0, faster=faster)
    title = f'Computing time of a control step, {_RUNS} runs each, on {cpu}'
    rows = [
        (name, f'{medians[name]:.2f}', f'{longest[name]:.2f}', f'{_PAPER_MS / medians[name]:.0f}')
        for name in steps
    ]
    columns = 'run', 'median [ms]', 'longest [ms]', 'paper / median'
    sheet.tables.append(Table(title, columns, rows))
    sheet.numbers |= {'cpu': cpu, 'paper_ms': _PAPER_MS, 'runs': _RUNS}
    sheet.numbers |= {'median_ms': medians, 'longest_ms': longest}


def _rates(
    sheet: Sheet, law: list[Convergence], full: list[Convergence], road: list[Convergence]
) -> None:
    arrived = sum(each.converged for each in full)
    sheet.claim(
        'fig5_rates',
        ClaimVerdict.DEPENDS if arrived < len(full) else ClaimVerdict.HOLDS,
        worst=max(float(each.ratios.max()) for each in law),
        last=max(float(each.ratios[-1]) for each in law),
        arrived=arrived,
    )
    tails = [_ratio(road[-1], at) for at in _TAIL]
    ratios = ', '.join(f'{ratio:.4f} at {at}' for ratio, at in zip(tails, _TAIL, strict=True))
    sheet.claim('fig5_linear', tails[-1] < tails[0], ratios=ratios)
    change, drift = road[-1].changes[-1], road[-1].drift
    verdict = ClaimVerdict.DEPENDS
    sheet.claim('fig5_drift', verdict, iterations=_LONG, change=change, drift=drift)
    by_miss = sorted(law, key=lambda each: each.first_miss)
    counts = ', '.join(f'{len(each.errors)} ({each.first_miss:.2f} m)' for each in by_miss)
    more = len(by_miss[-1].errors) > len(by_miss[0].errors)
    sheet.claim('fig5_crude', verdict if more else ClaimVerdict.FAILS, counts=counts)


def _theorem(sheet: Sheet, case1: Conditions, case3: Conditions, guess: Conditions) -> None:
    values: dict[str, Any] = {'case1': case1, 'case3': case3, 'guess': guess}
    every = case1, case3, guess
    full_rank = case1.rank_S_N == 2 and case3.rank_S_N == 2 and case3.rank_G == case3.columns_G
    free: dict[str, Any] = {'free1': case1.size - case1.rank_G, 'free3': case3.size - case3.rank_G}
    sheet.claim('theorem2_i', ClaimVerdict.DEPENDS)
    sheet.claim('theorem2_ii', min(each.least_eigenvalue for each in every) > 0.0, **values)
    sheet.claim('lemma1', max(each.neglected for each in every) < 0.01, **values)
    sheet.claim('theorem2_iii', ClaimVerdict.DEPENDS, **values)
    sheet.claim('theorem2_iii_b', full_rank, **values)
    sheet.claim('theorem2_iii_c', ClaimVerdict.FAILS, **values, **free)
    sheet.claim('bound_90', ClaimVerdict.UNDECIDABLE)


def _ratio(run: Convergence, at: int) -> float:
    return float(run.changes[at] / run.changes[at - 1])


def _table(law: list[Convergence], full: list[Convergence], road: list[Convergence]) -> Table:
    rows = [
        (
            f'({guess[0]:g}, {guess[1]:g})',
            f'{one.first_miss:.3f}',
            str(len(one.errors)),
            f'{one.ratios.max():.3f}',
            f'{one.ratios[-1]:.1e}',
            'converges' if two.converged else f'does not: miss {two.last_miss:.1e} m',
            f'{_ratio(three, _TAIL[0]):.4f} / {_ratio(three, _TAIL[-1]):.4f}',
        )
        for (guess, _), one, two, three in zip(FIG5_GUESSES, law, full, road, strict=True)
    ]
    columns = (
        'guess [rad/s]', 'ΔY_N of the guess [m]', 'iterations to 1e-8 rad/s, q = 0',
        'largest ratio (60)', 'last ratio', 'full steps (43)',
        f'q = 15: ratio of changes at {_TAIL[0]} / {_TAIL[-1]}',
    )  # fmt: skip
    return Table('Convergence from five guesses', columns, rows)


def _draw(law: list[Convergence], road: list[Convergence]) -> Figure:
    figure = Figure(figsize=(WIDTH, 0.46 * WIDTH), layout='constrained')
    grid = figure.add_gridspec(2, 2, height_ratios=(0.1, 1.0))
    left, right = figure.add_subplot(grid[1, 0]), figure.add_subplot(grid[1, 1])
    for (guess, color), one, other in zip(FIG5_GUESSES, law, road, strict=True):
        label = f'({guess[0]:g}, {guess[1]:g}) rad/s'
        iterations = np.arange(len(one.errors))
        left.semilogy(iterations, one.errors, 'o-', ms=2.5, color=color, label=label)
        right.loglog(np.arange(1, len(other.changes) + 1), other.changes, color=color)
    left.set(ylabel='|U$^i$ − U*| [rad/s]', title='(a) q = 0: distance from the solution')
    right.set(ylabel='|U$^{i}$ − U$^{i-1}$| [rad/s]', title='(b) q = 15: change in one iteration')
    for axes in (left, right):
        axes.set_xlabel('iteration i')
        axes.grid(visible=True)
    handles, _ = left.get_legend_handles_labels()
    key_above(figure.add_subplot(grid[0, :]), handles, 5)
    return figure
