"""The reason why a goal was not reached: what closes which way."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.goals import Target
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.world import SEEN
from cmpsp_ros.world.roads import Point, remaining_arc_length

SPACING: Final = 0.05
"""Distance of the points of a way at which its clearance is measured [m]."""


def way_left(settings: LawSettings, start: PlanStart, goal: Target) -> float:
    """Length of the way to the goal; infinite where none is known [m]."""
    if (search := start.world.map_search(settings)) is not None:
        return float(search.lengths(start.pose[None, :2], goal.position)[0])
    along = remaining_arc_length(
        start.world.road, start.pose[None], goal.position, goal.heading, start.progress
    )
    return abs(float(along[0]))


def tightest(settings: LawSettings, start: PlanStart, line: Array) -> tuple[Point, float, str]:
    """Place of least clearance on a line (x, y) [m], that clearance [m], and beside what."""
    space, poses = start.world.free_space(settings), np.zeros((len(line), 3))
    poses[:, :2] = line
    away = space.at(poses)
    k, j = np.unravel_index(int(away.argmin()), away.shape)
    return (float(line[k, 0]), float(line[k, 1])), float(away[k, j]), start.world.names[j]


def why_unreachable(
    settings: LawSettings, start: PlanStart, goal: Point, blocked: tuple[Point, ...], last: str
) -> str:
    """Sentence that names what closes which way; `last` is added where everything is wide enough.

    `blocked` are the places that did not fit (x, y) [m].
    """
    search, places = start.world.map_search(settings), [start.pose[None, :2]]
    if search is not None:
        line = search.line(start.pose[:2], goal, SPACING)
        places = [np.array([each]) for each in blocked] or [line]
        if not len(line):
            # The way of a point shows what is too narrow, or the wall that is thinnest.
            point = replace(search, wanted=0.0, margin=0.0, body=-math.inf, blocked=())
            line = point.line(start.pose[:2], goal, SPACING)
            places = [line if len(line) else np.array([goal])]
    body, parts, least, is_coarse = settings.robot_radius, [], math.inf, False
    margin, cell = settings.safety.margin, settings.sight.resolution
    for each in places:
        (x, y), clear, name = tightest(settings, start, each)
        least = min(least, clear)
        is_coarse |= name == f'obstacle {SEEN}' and -cell <= clear < margin
        beside = max(clear + body, 0.0)
        parts.append(f'past {name} at ({x:.2f}, {y:.2f}), which leaves {beside:.3f} m')
    reason = (
        f'The goal is unreachable: no plan gets {", nor ".join(parts)} beside the path; the'
        f' robot needs {body:.3f} m, and {margin:.3f} m of margin.'
    )
    if is_coarse:
        reason += (
            f' Cells of {cell:.3g} m make what is seen up to as much larger on each side: a smaller'
            ' sight.resolution may find space.'
        )
    return f'{reason} {last}' if least >= 0.0 else reason
