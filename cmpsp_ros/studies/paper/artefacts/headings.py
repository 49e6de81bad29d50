"""Table 2, Figs. 8 and 9: Case 3 from three headings."""

from __future__ import annotations

from cmpsp_ros.studies.paper.claims import Artefact, Claim, Verdict
from cmpsp_ros.studies.paper.compare import (
    ARRIVED,
    apart,
    least_clearance,
    millimetres,
    numbers,
    runs_table,
    wheels_apart,
    within_limits,
    worst_miss,
)
from cmpsp_ros.studies.paper.drives import Laboratory
from cmpsp_ros.studies.paper.experiments import table2
from cmpsp_ros.studies.paper.pictures import draw_trajectories, draw_wheel_speeds

_SECTION = 'Sec. 5, Different Initial States'


def table_2(lab: Laboratory) -> Artefact:
    """The three headings, and the start that is printed."""
    panels = lab.both(table2())
    printed = [lab.drive(each, between_samples=True) for each in table2(as_printed=True)]
    obstacles = [float(drive.path.clearance(between_samples=True)[2:].min()) for drive in printed]
    claims = [
        Claim(
            'Table 2',
            'initial y = 9.25 m',
            f'from y = +9.25 m the goal is reached too (miss {worst_miss(printed):.1e} m), but by'
            f' the other quarter of the road, {min(obstacles):.1f} m from any obstacle',
            Verdict.FAILS,
            'A lost sign: the start must have y_0 in (-11, -9), and all other runs start from'
            ' -9.25 m, which is used.',
        ),
        Claim(
            'Table 2',
            'colours "in Figs. 6 and 7" for rows 2 and 3',
            'Figs. 6 and 7 belong to Table 1',
            Verdict.FAILS,
            'A misprint for Figs. 8 and 9, which row 1 names.',
        ),
    ]
    return Artefact(
        'The three headings of Table 2',
        {
            **numbers(panels, ()),
            'from_y_9.25': {drive.experiment.key: drive.measures() for drive in printed},
        },
        claims,
        tables=[runs_table('Table 2, from y = -9.25 m', *panels)],
    )


def fig8(lab: Laboratory) -> Artefact:
    """Trajectories from the three headings."""
    panels = lab.both(table2())
    drives = [*panels[0], *panels[1]]
    miss, kept = worst_miss(drives), least_clearance(panels[1], between_samples=True)
    cut = least_clearance(panels[0], between_samples=True)
    distances = apart([drive.path for drive in panels[0]])
    claims = [
        Claim(
            f'{_SECTION}, Fig. 8',
            '"can meet all the desired objectives and reach the required final point while'
            ' satisfying all the path constraints"',
            f'largest miss {miss:.1e} m; clear by {millimetres(kept)} mm with the bound,'
            f' {millimetres(cut)} mm between samples without it',
            Verdict.of(miss < ARRIVED and kept >= 0.0 and within_limits(drives)),
            'With the bound. As the paper has it, at the samples only, the path between them'
            ' cuts an obstacle or an edge.'
            if cut < 0.0
            else 'At the samples and between them.',
        ),
        Claim(
            f'{_SECTION}, Fig. 8',
            '"the trajectory followed for each case is again different even though the initial'
            ' guess control is the same"',
            'largest distance at equal times, pair by pair: '
            + ', '.join(f'{value * 1e3:.0f}' for value in distances)
            + ' mm',
            Verdict.of(bool((distances > 0.1).all())),
            'The heading decides where the first second leads; the rest follows from that.',
        ),
    ]
    return Artefact(
        'Trajectories from the three headings of Table 2',
        {**numbers(panels, ('x_m', 'y_m')), 'apart_m': distances.tolist()},
        claims,
        draw_trajectories(panels),
    )


def fig9(lab: Laboratory) -> Artefact:
    """Wheel speeds from the three headings."""
    panels = lab.both(table2())
    differences = wheels_apart([drive.path for drive in panels[0]])
    return Artefact(
        'Wheel speeds from the three headings of Table 2',
        {
            **numbers(panels, ('t_s', 'right_rad_s', 'left_rad_s')),
            'apart_rad_s': differences.tolist(),
        },
        [
            Claim(
                f'{_SECTION}, Fig. 9',
                '"satisfying all the path constraints", here the limit (94)',
                'largest '
                + ', '.join(f'{abs(drive.path.controls).max():.2f}' for drive in panels[0])
                + ' rad/s',
                Verdict.of(within_limits([*panels[0], *panels[1]])),
                'Limits are bounds of the quadratic program and are met exactly.',
            )
        ],
        draw_wheel_speeds(panels),
    )
