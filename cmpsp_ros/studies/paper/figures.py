"""Checks of the figures and tables with runs: Cases 1 to 3, Tables 1 and 2, zero to five obstacles.

Each takes a sheet with its runs and adds claims, further numbers and tables. The texts of the
claims are in `claims.toml`.
"""

from collections.abc import Iterator
from itertools import combinations
from typing import Any

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.studies.paper.drives import (
    ARRIVED,
    TOUCHED,
    Panels,
    apart,
    guessed_path,
    least_clearance,
    spans,
    wheels_apart,
    within_limits,
    worst_miss,
)
from cmpsp_ros.studies.paper.experiments import case3_at_45, cases, road_guess, table1, table2
from cmpsp_ros.studies.paper.ipopt import reference_solution
from cmpsp_ros.studies.paper.iterations import Recipe, follow
from cmpsp_ros.studies.paper.report import ClaimVerdict, Sheet, Table, millimetres

_PAPER_PEAKS = 52.7, 50.4
_NEAR = 0.05
_NEAR_EDGE = 0.5
# Distance [m], or difference of wheel speeds [rad/s], from which two runs are different.
_DIFFERENT = 0.1


def fig2(sheet: Sheet) -> None:
    """Trajectories of the three cases."""
    plain, bound = sheet.panels
    case1, case2, case3 = (drive.path for drive in plain)
    slow = sheet.lab.drive(case3_at_45(), between_samples=False).path
    miss = worst_miss(sheet.panels.drives)
    sheet.claim('fig2_goal', miss < ARRIVED, miss=miss)
    arrival = float(case1.times[np.abs(case1.off_center) < _NEAR][0])
    later = float(np.abs(case1.off_center[case1.times >= arrival]).max())
    sheet.claim('fig2_center', later < 2.0 * _NEAR, arrival=arrival, later=later * 1e3)
    compared = case2, case3, slow
    outside = [path.off_center > 0.0 for path in compared]
    sheet.claim(
        'fig2_return',
        ClaimVerdict.DEPENDS,
        means=', '.join(f'{np.abs(path.off_center).mean() * 1e3:.0f}' for path in compared),
        crossings=', '.join(str(np.count_nonzero(np.diff(each))) for each in outside),
        gap=float(apart([case2, case3])[0]) * 1e3,
    )
    at = least_clearance(plain, between_samples=False)
    between = least_clearance(plain, between_samples=True)
    kept = least_clearance(bound, between_samples=True)
    sheet.claim(
        'fig2_avoid',
        ClaimVerdict.HOLDS if between >= 0.0 else ClaimVerdict.DEPENDS,
        otherwise=at < TOUCHED or kept < 0.0,
        at=millimetres(at),
        between=millimetres(between),
        kept=millimetres(kept),
    )


def fig3(sheet: Sheet) -> None:
    """Position and heading of the three cases."""
    headings = [float(np.degrees(drive.path.poses[-1, 2])) for drive in sheet.panels.bound]
    miss = worst_miss(sheet.panels.drives)
    sheet.claim('fig3_goal', miss < ARRIVED, miss=miss)
    differ = headings[1] - headings[0] > 1.0 and headings[2] - headings[0] > 1.0
    text = ', '.join(f'{heading:.1f}°' for heading in headings)
    sheet.claim('fig3_heading', differ, headings=text)


def fig4(sheet: Sheet) -> None:
    """Wheel speeds of the three cases, and of Case 3 at the limit that the text gives."""
    plain, bound = sheet.panels
    case1, case2, case3, at_45 = (drive.path for drive in plain)
    sheet.tables.append(Table.of_runs('Case 3 with 45 rad/s', [plain[3], bound[3]]))
    spread = float(np.ptp(case1.controls[case1.times[:-1] >= 2.0], axis=0).max())
    sheet.claim('fig4_steady', spread < 1.0, spread=spread)
    peaks = case2.peaks
    sheet.claim(
        'fig4_peaks',
        ClaimVerdict.DEPENDS,
        plain=peaks,
        bound=bound[1].path.peaks,
        text=follow(plain[1].experiment, Recipe.AS_WRITTEN).peaks,
        larger=peaks.max() / max(_PAPER_PEAKS) - 1,
        smaller=peaks.min() / min(_PAPER_PEAKS) - 1,
    )
    full, slow = case3.saturated, at_45.saturated
    right, left = np.count_nonzero(full, axis=0)
    sheet.claim(
        'fig4_limit',
        ClaimVerdict.DEPENDS,
        right=right,
        left=left,
        steps=len(full),
        share=slow.mean(axis=0),
        clear=millimetres(least_clearance(bound[3:], between_samples=True)),
    )
    before_8 = slow[at_45.times[:-1] < 8.0].mean(axis=0)
    verdict = ClaimVerdict.DEPENDS if max(before_8) > 0.5 else ClaimVerdict.FAILS
    sheet.claim('fig4_saturated', verdict, before_8=before_8)
    left_spans = spans(slow[:, 1]), spans(full[:, 1])
    sheet.claim('fig4_spans', 2 in left_spans, slow=left_spans[0], full=left_spans[1])


def table_1(sheet: Sheet) -> None:
    """The four guesses, and all ten runs by the paper's text alone."""
    _admissible(sheet, 'table1_all')
    sheet.lab.progress('driving all ten runs as the text has them, and with one plan alone')
    ten = [*cases(), *table1(), *table2()]
    others = {
        recipe: {each.key: follow(each, recipe).measures() for each in ten}
        for recipe in (Recipe.AS_WRITTEN, Recipe.ONE_PLAN)
    }
    written, alone = (
        sum(run['miss_m'] < ARRIVED for run in runs.values()) for runs in others.values()
    )
    sheet.claim('table1_as_written', written == len(ten), as_written=written, one_plan=alone)
    sheet.numbers |= {recipe.name.lower(): runs for recipe, runs in others.items()}
    columns = (
        'run',
        *(
            f'{recipe.value}: miss [m]' if first else 'clearance at samples [mm]'
            for recipe in others
            for first in (True, False)
        ),
    )
    rows = [(each.label, *_miss_and_clearance(each.key, *others.values())) for each in ten]
    title = 'The ten runs without this law: as the text has it, and with one plan alone'
    sheet.tables.append(Table(title, columns, rows))


def fig6(sheet: Sheet) -> None:
    """Trajectories from the four guesses."""
    drives = sheet.panels.plain
    distances = apart([drive.path for drive in drives])
    road = sheet.lab.drive(road_guess(), between_samples=False).path
    alone = [follow(drive.experiment, Recipe.ONE_PLAN) for drive in drives]
    sheet.claim(
        'fig6_different',
        bool((distances > _DIFFERENT).all()),
        pairs=_pairs(distances * 1e3),
        forgotten=sum(np.array_equal(road.poses, drive.path.poses) for drive in drives),
        alone=apart(alone).max(),
        short=sum(path.miss > ARRIVED for path in alone),
    )
    sheet.claim('fig6_independent', ClaimVerdict.DEPENDS, apart=distances.max() * 1e3)
    sheet.numbers['apart_m'] = _by_pair(sheet.panels, distances)


def fig7(sheet: Sheet) -> None:
    """Wheel speeds from the four guesses."""
    differences = wheels_apart([drive.path for drive in sheet.panels.plain])
    sheet.claim('fig7', bool((differences > _DIFFERENT).all()), pairs=_pairs(differences))
    sheet.numbers['apart_rad_s'] = _by_pair(sheet.panels, differences)


def table_2(sheet: Sheet) -> None:
    """The three headings, and the start that is printed."""
    printed = [sheet.lab.drive(each, between_samples=True) for each in table2(as_printed=True)]
    away = min(float(drive.path.clearance(between_samples=True)[2:].min()) for drive in printed)
    sheet.claim('table2_sign', ClaimVerdict.FAILS, miss=worst_miss(printed), away=away)
    sheet.claim('table2_figures', ClaimVerdict.FAILS)
    sheet.numbers['from_y_9.25'] = {drive.experiment.key: drive.measures() for drive in printed}


def fig8(sheet: Sheet) -> None:
    """Trajectories from the three headings."""
    _admissible(sheet, 'fig8_objectives', otherwise=True)
    distances = apart([drive.path for drive in sheet.panels.plain])
    pairs = ', '.join(f'{value * 1e3:.0f}' for value in distances)
    sheet.claim('fig8_different', bool((distances > _DIFFERENT).all()), pairs=pairs)
    sheet.numbers['apart_m'] = distances.tolist()


def fig9(sheet: Sheet) -> None:
    """Wheel speeds from the three headings."""
    paths = [drive.path for drive in sheet.panels.plain]
    peaks = ', '.join(f'{path.peaks.max():.2f}' for path in paths)
    sheet.claim('fig9', within_limits(sheet.panels.drives), peaks=peaks)
    sheet.numbers['apart_rad_s'] = wheels_apart(paths).tolist()


def fig10(sheet: Sheet) -> None:
    """Trajectories with zero, one and two obstacles."""
    guess = guessed_path(sheet.panels.plain[0].experiment)
    sheet.claim('fig10_counts', ClaimVerdict.DEPENDS)
    turned = float(np.ptp(guess.poses[:, 2]))
    speed = guess.controls[0, 0]
    sheet.claim('fig10_straight', ClaimVerdict.UNDECIDABLE, speed=speed, turned=turned)
    costs = ', '.join(f'{drive.path.cost:.1f}' for drive in sheet.panels.bound)
    _admissible(sheet, 'fig10_intuitive', ClaimVerdict.DEPENDS, costs=costs)
    sheet.numbers |= _optima(sheet)


def fig12(sheet: Sheet) -> None:
    """Trajectories with three, four and five obstacles."""
    bound = sheet.panels.bound
    costs, optima = [drive.path.cost for drive in bound], _optima(sheet)
    sheet.claim('fig12_positions', ClaimVerdict.UNDECIDABLE)
    _admissible(sheet, 'fig12_admissible')
    shares = [float((np.abs(drive.path.off_center) > _NEAR_EDGE).mean()) for drive in bound]
    text = ', '.join(f'{share:.0%}' for share in shares)
    sheet.claim('fig12_boundary', ClaimVerdict.DEPENDS, shares=text)
    gap = ''
    if optima:
        best = [each['cost'] for each in optima['ipopt'].values()]
        over = ', '.join(f'{cost / least:.2f}' for cost, least in zip(costs, best, strict=True))
        gap = f' Over the optimum found by IPOPT from there: {over}.'
    sheet.claim(
        'fig12_deteriorates',
        ClaimVerdict.DEPENDS,
        costs=', '.join(f'{cost:.0f}' for cost in costs),
        slack=', '.join(str(drive.steps_with_slack) for drive in bound),
        gap=gap,
    )
    sheet.numbers |= optima
    obstacles = sheet.panels.plain[-1].path.settings.obstacles
    rows = [
        (each.name, f'({each.center[0]:g}, {each.center[1]:g})', f'{each.radius:g}')
        for each in obstacles
    ]
    columns = 'name', 'centre [m]', 'radius [m]'
    sheet.tables.append(Table('Where the obstacles are', columns, rows))


def obstacle_wheel_speeds(sheet: Sheet, figure: str) -> None:
    """Wheel speeds with several numbers of obstacles, in a figure of the paper."""
    guess = sheet.panels.plain[0].experiment.settings.initial_guess.wheel_speeds
    largest = max(float(drive.path.peaks.max()) for drive in sheet.panels.drives)
    verdict = ClaimVerdict.UNDECIDABLE
    sheet.claim('wheel_speeds', verdict, figure=figure, guess=guess, largest=largest)


def _admissible(
    sheet: Sheet,
    key: str,
    verdict: ClaimVerdict = ClaimVerdict.HOLDS,
    *,
    otherwise: bool = False,
    **values: object,
) -> None:
    """Claim that all runs arrive and keep clear; the second reason may be for cut corners."""
    (plain, bound), drives = sheet.panels, sheet.panels.drives
    miss, kept = worst_miss(drives), least_clearance(bound, between_samples=True)
    at, cut = (least_clearance(plain, between_samples=each) for each in (False, True))
    holds = miss < ARRIVED and kept >= 0.0 and within_limits(drives)
    sheet.claim(
        key,
        verdict if holds else ClaimVerdict.FAILS,
        otherwise=otherwise and cut < 0.0,
        miss=miss,
        kept=millimetres(kept),
        at=millimetres(at),
        cut=millimetres(cut),
        **values,
    )


def _optima(sheet: Sheet) -> dict[str, Any]:
    if not sheet.lab.judge:
        return {}
    optima = {}
    for drive in sheet.panels.bound:
        sheet.lab.progress(f'judging {drive.experiment.key} by IPOPT')
        found = reference_solution(drive.path.settings, drive.path.poses[0], drive.path)
        values = {'feasible': found.feasible, 'status': found.status, 'cost': found.cost}
        optima[drive.experiment.key] = values
    return {'ipopt': optima}


def _miss_and_clearance(key: str, *recipes: dict[str, dict[str, Any]]) -> Iterator[str]:
    for runs in recipes:
        yield f'{runs[key]["miss_m"]:.1e}'
        yield millimetres(runs[key]['clearance_at_samples_m'])


def _pairs(values: Array) -> str:
    return ', '.join(f'{value:.3g}' for value in values)


def _by_pair(panels: Panels, values: Array) -> dict[str, float]:
    pairs = combinations([drive.experiment.key for drive in panels.plain], 2)
    return {f'{one}, {other}': float(v) for (one, other), v in zip(pairs, values, strict=True)}
