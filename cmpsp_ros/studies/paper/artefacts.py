"""The paper's figures and tables: one table of them, and one runner."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from matplotlib.figure import Figure

from cmpsp_ros.studies.common import StudyError, disk_errors, plot_style
from cmpsp_ros.studies.paper import convergence, figures
from cmpsp_ros.studies.paper.drives import Laboratory, Panels, guessed_path
from cmpsp_ros.studies.paper.experiments import (
    Experiment,
    case3_at_45,
    cases,
    few_obstacles,
    many_obstacles,
    table1,
    table2,
)
from cmpsp_ros.studies.paper.pictures import draw_poses, draw_trajectories, draw_wheel_speeds, save
from cmpsp_ros.studies.paper.report import Sheet, Table, write_report

_WHEELS = ('t_s', 'right_rad_s', 'left_rad_s')
_PATHS = ('x_m', 'y_m')


class Artefact(NamedTuple):
    """A figure or table of the paper, its runs, and what is drawn of them."""

    title: str
    check: Callable[[Sheet], None]  # adds claims, further numbers and tables
    runs: Callable[[], Sequence[Experiment]] = tuple
    series: Sequence[str] = ()  # of the runs, for `results.json`
    table: str = ''  # heading of a table of the runs; empty for none
    draw: Callable[[Panels], Figure] | None = None


def _with_guess(panels: Panels) -> Figure:
    return draw_trajectories(panels, guessed_path(panels.plain[0].experiment))


def _wheels_with_guess(panels: Panels) -> Figure:
    return draw_wheel_speeds(
        panels, [panels.plain[0].experiment.settings.initial_guess.wheel_speeds]
    )


_ARTEFACTS: Final[Mapping[str, Artefact]] = {
    'fig2': Artefact(
        'Trajectories of Cases 1 to 3', figures.fig2, cases, _PATHS, 'Cases 1 to 3',
        draw_trajectories,
    ),
    'fig3': Artefact(
        'Position and heading in Cases 1 to 3', figures.fig3, cases,
        ('t_s', *_PATHS, 'heading_rad'), '', draw_poses,
    ),
    'fig4': Artefact(
        'Wheel speeds in Cases 1 to 3, and in Case 3 with the 45 rad/s of the text', figures.fig4,
        lambda: (*cases(), case3_at_45()), _WHEELS, '', draw_wheel_speeds,
    ),
    'fig5': Artefact(
        'Convergence without constraints: q = 0 and, beside it, q = 15', convergence.fig5
    ),
    'table1': Artefact('The four guesses of Table 1', figures.table_1, table1, (), 'Table 1'),
    'fig6': Artefact(
        'Trajectories from the four guesses of Table 1', figures.fig6, table1, _PATHS, '',
        lambda panels: draw_trajectories(panels, coincide=True),
    ),
    'fig7': Artefact(
        'Wheel speeds from the four guesses of Table 1', figures.fig7, table1, _WHEELS, '',
        lambda panels: draw_wheel_speeds(panels, coincide=True),
    ),
    'table2': Artefact(
        'The three headings of Table 2', figures.table_2, table2, (), 'Table 2, from y = -9.25 m'
    ),
    'fig8': Artefact(
        'Trajectories from the three headings of Table 2', figures.fig8, table2, _PATHS, '',
        draw_trajectories,
    ),
    'fig9': Artefact(
        'Wheel speeds from the three headings of Table 2', figures.fig9, table2, _WHEELS, '',
        draw_wheel_speeds,
    ),
    'fig10': Artefact(
        'Trajectories with zero, one and two obstacles', figures.fig10, few_obstacles, _PATHS,
        'Zero, one and two obstacles', _with_guess,
    ),
    'fig11': Artefact(
        'Wheel speeds with zero, one and two obstacles',
        lambda sheet: figures.obstacle_wheel_speeds(sheet, 'Fig. 11'), few_obstacles, _WHEELS, '',
        _wheels_with_guess,
    ),
    'fig12': Artefact(
        'Trajectories with three, four and five obstacles', figures.fig12, many_obstacles, _PATHS,
        'Three, four and five obstacles', _with_guess,
    ),
    'fig13': Artefact(
        'Wheel speeds with three, four and five obstacles',
        lambda sheet: figures.obstacle_wheel_speeds(sheet, 'Fig. 13'), many_obstacles, _WHEELS,
        '', _wheels_with_guess,
    ),
    'timing': Artefact('Computing time', convergence.timing),
}  # fmt: skip

# Names of the paper's figures and tables, in its order, and of the computing time.
ARTEFACTS: Final[tuple[str, ...]] = tuple(_ARTEFACTS)


def run(
    output: Path,
    only: Sequence[str] = (),
    progress: Callable[[str], None] = lambda _: None,
    *,
    judge: bool = False,
) -> Path:
    """Reproduce figures and tables, all or those named, in a new folder; the path of the report.

    Beside it are `results.json` and each figure; to `judge`, IPOPT finds optima, which needs
    CasADi.
    """
    if unknown := [name for name in only if name not in _ARTEFACTS]:
        raise StudyError(f'only: found {", ".join(unknown)}, wanted some of {", ".join(ARTEFACTS)}')
    with disk_errors(output):
        if output.exists() and (not output.is_dir() or any(output.iterdir())):
            raise StudyError(f'{output}: found something there, wanted a new or empty folder')
        output.mkdir(parents=True, exist_ok=True)
    lab = Laboratory(progress, judge=judge)
    sheets: dict[str, Sheet] = {}
    with plot_style():
        for name, artefact in _ARTEFACTS.items():
            if only and name not in only:
                continue
            progress(name)
            sheets[name] = sheet = _fill(artefact, lab)
            if sheet.figure is not None:
                save(sheet.figure, output, name)
    content = {name: sheet.content() for name, sheet in sheets.items()}
    text = json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False)
    (output / 'results.json').write_text(text + '\n', encoding='utf-8')
    path = output / 'results.md'
    path.write_text(write_report(sheets), encoding='utf-8')
    return path


def _fill(artefact: Artefact, lab: Laboratory) -> Sheet:
    panels = lab.both(artefact.runs())
    sheet = Sheet(artefact.title, lab, panels)
    if panels.drives:
        sheet.numbers |= panels.numbers(artefact.series)
    if artefact.table:
        sheet.tables.append(Table.of_runs(artefact.table, panels.drives))
    artefact.check(sheet)
    if artefact.draw is not None:
        sheet.figure = artefact.draw(panels)
    return sheet
