"""Figs. 10 to 13: with zero to five obstacles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cmpsp_ros.studies.paper.claims import Artefact, Claim, Table, Verdict
from cmpsp_ros.studies.paper.compare import (
    ARRIVED,
    least_clearance,
    millimetres,
    numbers,
    runs_table,
    within_limits,
    worst_miss,
)
from cmpsp_ros.studies.paper.drives import Drive, Laboratory, guessed_path
from cmpsp_ros.studies.paper.experiments import few_obstacles, many_obstacles
from cmpsp_ros.studies.paper.judge import judge
from cmpsp_ros.studies.paper.pictures import draw_trajectories, draw_wheel_speeds

_SECTION = 'Sec. 5, More Number of Obstacles'
_NEAR_EDGE = 0.5


def fig10(lab: Laboratory) -> Artefact:
    """Trajectories with zero, one and two obstacles."""
    panels = lab.both(few_obstacles())
    guess = guessed_path(panels[0][0].experiment)
    turned = float(np.ptp(guess.poses[:, 2]))
    claims = [
        Claim(
            f'{_SECTION}, Fig. 10',
            "caption: zero, one and three obstacles; text: \"'zero' …, 'one' …, and 'two'\"",
            'zero, one and two are drawn',
            Verdict.DEPENDS,
            'The paper contradicts itself; three is the first of Fig. 12, in another colour.',
        ),
        Claim(
            f'{_SECTION}, Fig. 10',
            'the trajectory of the guess "is a straight line"',
            f'with equal wheels, {guess.controls[0, 0]:g} rad/s, it turns by {turned:g} rad',
            Verdict.UNDECIDABLE,
            'True of any equal speeds; the paper gives none. The second guess of Table 1 is used.',
        ),
        _intuitive(panels),
    ]
    return Artefact(
        'Trajectories with zero, one and two obstacles',
        {**numbers(panels, ('x_m', 'y_m')), **_judged(lab, panels)},
        claims,
        draw_trajectories(panels, guess),
        [runs_table('Zero, one and two obstacles', *panels)],
    )


def fig11(lab: Laboratory) -> Artefact:
    """Wheel speeds with zero, one and two obstacles."""
    return _wheel_speeds(lab.both(few_obstacles()), 'zero, one and two', 'Fig. 11')


def fig12(lab: Laboratory) -> Artefact:
    """Trajectories with three, four and five obstacles."""
    panels = lab.both(many_obstacles())
    shares = [_beside_an_edge(drive) for drive in panels[1]]
    costs = [drive.path.cost for drive in panels[1]]
    slack = [sum(level != 'nominal' for level in drive.levels) for drive in panels[1]]
    judged = _judged(lab, panels)
    claims = [
        Claim(
            f'{_SECTION}, Fig. 12',
            'positions of three, four and five obstacles',
            'published in config/paper/three_obstacles.yaml to five_obstacles.yaml',
            Verdict.UNDECIDABLE,
            'The paper gives none. Ours leave lanes of about 0.3 m; a test of this package has an'
            ' independent solver (IPOPT) find each of them feasible.',
        ),
        _admissible(
            f'{_SECTION}, Fig. 12',
            'when obstacles "are more, and they are closely spaced; the C-MPSP algorithm gives an'
            ' admissible trajectory (satisfying all the constraints)"',
            panels,
            'On our positions.',
        ),
        Claim(
            f'{_SECTION}, Fig. 12',
            'with five obstacles "most part of the trajectory merges with the boundary of the'
            ' path"',
            'share of the time more than 0.5 m off the middle, so nearer to an edge, with three,'
            ' four, five obstacles: ' + ', '.join(f'{share:.0%}' for share in shares),
            Verdict.DEPENDS,
            'On the positions. Lanes beside our obstacles lie along the edges, and between two'
            ' obstacles there is no time to come back to the middle.',
        ),
        Claim(
            f'{_SECTION}, Fig. 12',
            '"the performance of the C-MPSP algorithm started deteriorating"',
            'cost (95) with three, four, five: '
            + ', '.join(f'{cost:.0f}' for cost in costs)
            + '; steps that needed slack: '
            + ', '.join(map(str, slack)),
            Verdict.DEPENDS,
            'On the yardstick. The cost rises, and with five obstacles slack is needed for once,'
            ' but the best path there is costs more as well.' + _gap(judged, costs),
        ),
    ]
    return Artefact(
        'Trajectories with three, four and five obstacles',
        {**numbers(panels, ('x_m', 'y_m')), **judged},
        claims,
        draw_trajectories(panels, guessed_path(panels[0][0].experiment)),
        [
            runs_table('Three, four and five obstacles', *panels),
            Table(
                'Where the obstacles are',
                ('name', 'centre [m]', 'radius [m]'),
                [
                    (each.name, f'({each.center[0]:g}, {each.center[1]:g})', f'{each.radius:g}')
                    for each in panels[0][-1].path.settings.obstacles
                ],
            ),
        ],
    )


def fig13(lab: Laboratory) -> Artefact:
    """Wheel speeds with three, four and five obstacles."""
    return _wheel_speeds(lab.both(many_obstacles()), 'three, four and five', 'Fig. 13')


def _wheel_speeds(panels: tuple[list[Drive], list[Drive]], counts: str, figure: str) -> Artefact:
    guess = panels[0][0].experiment.settings.initial_guess.wheel_speeds
    largest = max(float(abs(drive.path.controls).max()) for drive in (*panels[0], *panels[1]))
    return Artefact(
        f'Wheel speeds with {counts} obstacles',
        numbers(panels, ('t_s', 'right_rad_s', 'left_rad_s')),
        [
            Claim(
                f'{_SECTION}, {figure}',
                'the guess is "the same" for all three and "shown as" dotted straight lines',
                f'({guess[0]:g}, {guess[1]:g}) rad/s; from it no wheel exceeds {largest:.2f} rad/s',
                Verdict.UNDECIDABLE,
                'Neither the guess nor the wheel limit of these runs is given; 51 rad/s is used.',
            )
        ],
        draw_wheel_speeds(panels, [guess]),
    )


def _admissible(
    where: str, says: str, panels: tuple[list[Drive], list[Drive]], reason: str
) -> Claim:
    plain, bound = panels
    miss, kept = worst_miss([*plain, *bound]), least_clearance(bound, between_samples=True)
    at = least_clearance(plain, between_samples=False)
    cut = least_clearance(plain, between_samples=True)
    return Claim(
        where,
        says,
        f'largest miss {miss:.1e} m; clear by {millimetres(kept)} mm with the bound; samples only:'
        f' {millimetres(at)} mm at the samples, {millimetres(cut)} mm between them',
        Verdict.of(miss < ARRIVED and kept >= 0.0 and within_limits([*plain, *bound])),
        reason,
    )


def _intuitive(panels: tuple[list[Drive], list[Drive]]) -> Claim:
    zero, one, two = (drive.path.cost for drive in panels[1])
    claim = _admissible(
        f'{_SECTION}, Fig. 12 on Fig. 10',
        'when obstacles "are up to three, and they are spaced sparsely; the C-MPSP gives an'
        ' intuitive trajectory"',
        panels,
        'On the guess. All are admissible. But with no obstacle the straight guess needs no slack'
        ' and is kept, and the path takes the inner side of the road first; with an obstacle the'
        ' guess needs slack, and a fresh plan along the road replaces it.',
    )
    costs = f'cost (95) with zero, one, two: {zero:.1f}, {one:.1f}, {two:.1f}'
    verdict = Verdict.DEPENDS if claim.verdict is Verdict.HOLDS else claim.verdict
    return replace(claim, found=f'{claim.found}; {costs}', verdict=verdict)


def _beside_an_edge(drive: Drive) -> float:
    """Share of the time nearer to an edge of the road than to its middle."""
    return float((np.abs(drive.path.off_center) > _NEAR_EDGE).mean())


def _judged(lab: Laboratory, panels: Sequence[Sequence[Drive]]) -> dict[str, Any]:
    """IPOPT's optimum of each run with the bound, where a judge is wanted."""
    if not lab.judge:
        return {}
    judged = {}
    for drive in panels[1]:
        lab.progress(f'judging {drive.experiment.key} by IPOPT')
        path = drive.path
        verdict = judge(path.settings, path.poses[0], path)
        judged[drive.experiment.key] = {
            'feasible': verdict.feasible,
            'status': verdict.status,
            'cost': verdict.cost,
        }
    return {'ipopt': judged}


def _gap(judged: dict[str, Any], costs: list[float]) -> str:
    if not judged:
        return ''
    best = [each['cost'] for each in judged['ipopt'].values()]
    over = ', '.join(f'{cost / least:.2f}' for cost, least in zip(costs, best, strict=True))
    return f' Over the optimum found by IPOPT from there: {over}.'
