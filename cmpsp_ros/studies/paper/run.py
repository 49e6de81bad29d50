"""The whole study: makes the requested artefacts and writes them to a folder."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from cmpsp_ros.studies.errors import StudyError
from cmpsp_ros.studies.paper import pictures, report
from cmpsp_ros.studies.paper.artefacts.cases import fig2, fig3, fig4
from cmpsp_ros.studies.paper.artefacts.convergence import fig5
from cmpsp_ros.studies.paper.artefacts.guesses import fig6, fig7, table_1
from cmpsp_ros.studies.paper.artefacts.headings import fig8, fig9, table_2
from cmpsp_ros.studies.paper.artefacts.obstacles import fig10, fig11, fig12, fig13
from cmpsp_ros.studies.paper.artefacts.timing import timing
from cmpsp_ros.studies.paper.claims import Artefact, Maker
from cmpsp_ros.studies.paper.drives import Laboratory
from cmpsp_ros.studies.plot_style import journal

_MAKERS: Final[Mapping[str, Maker]] = {
    'fig2': fig2,
    'fig3': fig3,
    'fig4': fig4,
    'fig5': fig5,
    'table1': table_1,
    'fig6': fig6,
    'fig7': fig7,
    'table2': table_2,
    'fig8': fig8,
    'fig9': fig9,
    'fig10': fig10,
    'fig11': fig11,
    'fig12': fig12,
    'fig13': fig13,
    'timing': timing,
}

ARTEFACTS: Final[tuple[str, ...]] = tuple(_MAKERS)
"""Names of the paper's figures and tables, in its order, and of the computing time."""


def run(
    output: Path,
    only: Sequence[str] = (),
    progress: Callable[[str], None] = lambda _: None,
    *,
    judge: bool = False,
) -> Path:
    """Reproduce the paper's figures and tables, and check its claims.

    Args:
        output: Folder to write to; made if it does not exist, and empty if it does.
        only: Names out of `ARTEFACTS`; all of them when empty.
        progress: Called with a line on the work in progress.
        judge: Whether IPOPT computes the optimum with many obstacles; needs CasADi.

    Returns:
        The report, `results.md`. Beside it are `results.json` and a PNG and an SVG of each figure.

    Raises:
        StudyError: A name is not known, or the folder cannot be used.
    """
    unknown = [name for name in only if name not in _MAKERS]
    if unknown:
        raise StudyError(f'only: found {", ".join(unknown)}, wanted some of {", ".join(ARTEFACTS)}')
    _make_folder(output)
    lab = Laboratory(progress, judge=judge)
    made: dict[str, Artefact] = {}
    with journal():
        for name in ARTEFACTS:
            if only and name not in only:
                continue
            progress(name)
            made[name] = _MAKERS[name](lab)
            figure = made[name].figure
            if figure is not None:
                pictures.save(figure, output, name)
    (output / 'results.json').write_text(_json(made), encoding='utf-8')
    path = output / 'results.md'
    path.write_text(report.write(made), encoding='utf-8')
    return path


def _make_folder(output: Path) -> None:
    try:
        if output.exists() and (not output.is_dir() or any(output.iterdir())):
            raise StudyError(f'{output}: found something there, wanted a new or empty folder')
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise StudyError(f'{output}: {error.strerror or error}') from error


def _json(made: Mapping[str, Artefact]) -> str:
    content: dict[str, Any] = {
        name: {
            'title': artefact.title,
            'claims': [
                {**vars(claim), 'verdict': claim.verdict.value} for claim in artefact.claims
            ],
            **artefact.numbers,
        }
        for name, artefact in made.items()
    }
    return json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False) + '\n'
