"""Roads and obstacles for the reference solver, as constraints of a nonlinear program.

The robot's own distance functions are not used. A point of a corridor is a point on a spline
through the centre line plus an offset between the edges; a convex shape is separated from the robot
by a line whose direction is a variable.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cmpsp_ros.guidance import GuidanceSettings
from cmpsp_ros.studies.paper.drives import Path
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.roads import Annulus

_KNOTS = 120
_DIRECTIONS = np.linspace(0.0, 2.0 * np.pi, 72, endpoint=False)


class JudgeSpace:
    """Adds the space to a program, stage by stage."""

    def __init__(self, casadi: Any, opti: Any, settings: GuidanceSettings, start: Path) -> None:
        """Make its variables.

        Args:
            casadi: The module.
            opti: The program.
            settings: Road and obstacles.
            start: Where variables begin.
        """
        self._casadi, self._opti, self._start = casadi, opti, start
        road = settings.road
        self._road, stages = road, len(start.poses)
        if road.has_center_line and not isinstance(road, Annulus):
            line = road.center_line()
            left, right = (np.hypot(*(edge - line).T) for edge in road.edges())
            along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(line, axis=0).T))])
            knots = np.linspace(0.0, along[-1], _KNOTS)
            normal = (road.edges()[0] - line) / left[:, None]
            columns = (*line.T, *normal.T, left, right)
            tables = [np.interp(knots, along, each) for each in columns]
            self._tables = [
                casadi.interpolant('table', 'bspline', [knots], table) for table in tables
            ]
            self._places, self._offsets = opti.variable(stages), opti.variable(stages)
            away = start.poses[:, None, :2] - line
            nearest = np.argmin((away**2).sum(axis=2), axis=1)
            opti.set_initial(self._places, along[nearest])
            opti.set_initial(
                self._offsets, (away[np.arange(stages), nearest] * normal[nearest]).sum(1)
            )

    def off_center(self, point: Any, k: int, space: FreeSpace) -> Any:
        """Keep a stage on the road.

        Args:
            point: Its position [m].
            k: Its number.
            space: The road and its free space.

        Returns:
            Its signed distance from the centre line [m]; 0 where there is none.
        """
        if not self._road.has_center_line:
            return 0.0
        if isinstance(self._road, Annulus):
            edges = space.annulus
            radius = self._casadi.sqrt(self._casadi.sumsqr(point - edges.center))
            if k > 0:
                inner, outer = float(edges.inner[0]), float(edges.outer[0])
                self._opti.subject_to(self._opti.bounded(inner, radius, outer))
            return radius - edges.center_radius
        place, offset = self._places[k], self._offsets[k]
        x, y, normal_x, normal_y, left, right = (table(place) for table in self._tables)
        self._opti.subject_to(point[0] == x + offset * normal_x)
        self._opti.subject_to(point[1] == y + offset * normal_y)
        if k > 0:
            kept = space.road.kept[0] / self._road.clearance_scale
            self._opti.subject_to(offset <= left - float(kept[0]))
            self._opti.subject_to(offset >= float(kept[1]) - right)
        return offset

    def keep_clear(self, point: Any, k: int, space: FreeSpace) -> None:
        """Keep a stage clear of the shapes; arguments as in `off_center`."""
        shapes = np.split(space.corners[0], space.first[1:-1]) if len(space.radii) else []
        for corners, kept in zip(shapes, space.radii.tolist(), strict=True):
            if len(corners) == 1:
                self._opti.subject_to(self._casadi.sumsqr(point - corners[0]) >= kept**2)
                continue
            angle = self._opti.variable()
            normals = np.column_stack([np.cos(_DIRECTIONS), np.sin(_DIRECTIONS)])
            away = (self._start.poses[k, :2] - corners) @ normals.T
            self._opti.set_initial(angle, _DIRECTIONS[away.min(axis=0).argmax()])
            normal = self._casadi.vertcat(self._casadi.cos(angle), self._casadi.sin(angle))
            for corner in corners:
                self._opti.subject_to(self._casadi.dot(normal, point - corner) >= kept)
