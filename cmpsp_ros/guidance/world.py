"""The world that the robot drives in, as one immutable value."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any, Final, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.world import FreeSpace, KeptLine, MapSearch, outside
from cmpsp_ros.world.grids import GridObstacle, OccupancyGrid
from cmpsp_ros.world.obstacles import Shape
from cmpsp_ros.world.roads import Annulus, Road, RoadSpace

SEEN: Final = 'seen'  # name of the obstacle that is made of all that sensors have seen

MAP: Final = 'map'  # name of the obstacle that a map is


class Searched(NamedTuple):
    """Inputs of the last search for a path across a grid, besides the known map."""

    seen: GridObstacle | None = None  # grid seen then; None for none
    kept: KeptLine | None = None  # the path before, while that is open; of a map none
    hysteresis: float = 0.1  # relative improvement required of another path while it is open
    blocked: tuple[tuple[float, float], ...] = ()  # places that did not fit in this run (x, y) [m]
    is_another: bool = False  # true if the path found differs from the one before


NOT_SEARCHED: Final = Searched()


@dataclass(frozen=True)
class World:
    """Road and static obstacles; replaced as a whole by sightings and messages.

    It caches free spaces and the search of the map.
    """

    road: Road
    obstacles: tuple[Shape, ...] = ()  # static obstacles that are known, a map included
    seen: GridObstacle | None = None  # grid seen by the sensors; None before the first sighting
    searched: Searched = NOT_SEARCHED  # inputs of the last search for a path across a grid

    def __getstate__(self) -> dict[str, Any]:
        """The fields alone: cached spaces hold addresses of compiled code in this process."""
        return {each.name: self.__dict__[each.name] for each in fields(self)}

    @cached_property
    def shapes(self) -> tuple[Shape, ...]:
        """All static obstacles: the known ones, and the seen grid."""
        return self.obstacles if self.seen is None else (*self.obstacles, self.seen)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of both edges and of all static obstacles, as messages have them."""
        return (*self.road.edge_names, *(f'obstacle {each.name}' for each in self.shapes))

    @cached_property
    def road_space(self) -> RoadSpace:
        """The whole road, for compiled code."""
        return self.road.space(0.0)

    @property
    def map(self) -> GridObstacle | None:
        """The map, if there is one."""
        grids = (each for each in self.obstacles if isinstance(each, GridObstacle))
        return next((each for each in grids if each.name == MAP), None)

    @property
    def annulus(self) -> Annulus:
        """The road between two circles; ValueError for another one."""
        if not isinstance(self.road, Annulus):
            found = type(self.road).__name__.lower()
            raise ValueError(f'road.type: found {found}, wanted annulus')  # noqa: TRY004
        return self.road

    def has_course_of(self, other: World) -> bool:
        """True if the other world has the same road and static obstacles, maps cell by cell."""
        if self.road != other.road or len(self.obstacles) != len(other.obstacles):
            return False
        return all(map(_are_equal, self.obstacles, other.obstacles))

    def seeing(self, grid: OccupancyGrid) -> World:
        """Copy with a seen grid; cells not seen yet are free for plans."""
        return replace(self, seen=GridObstacle(SEEN, grid, unknown_is_free=True))

    def free_space(self, settings: LawSettings, margin: float = 0.0) -> FreeSpace:
        """Poses where the robot is clear, with a margin [m] around it."""
        key = settings.robot_radius + margin, settings.footprint.centers
        if key not in self._spaces:
            discs = settings.footprint.discs
            self._spaces[key] = FreeSpace.of(self.road, self.shapes, key[0], discs)
        return self._spaces[key]

    def clearance(
        self, settings: LawSettings, poses: Array, twists: Array, durations: Array
    ) -> Array:
        """Least clearance of the robot's outline along arcs; as from `FreeSpace.along`."""
        spaces = [
            FreeSpace.of(self.road, self.shapes, radius, points)
            for points, radius in settings.bodies
        ]
        return np.asarray(np.max([each.along(poses, twists, durations) for each in spaces], axis=0))

    def map_search(self, settings: LawSettings) -> MapSearch | None:
        """Search of a grid for the path to a goal; None on a road, and without a grid."""
        if self.road.has_center_line or all(each.corners for each in self._searchable):
            return None
        wanted = settings.kept
        if settings.safety.between_samples and math.isfinite(settings.robot.max_wheel_speed):
            limits = settings.footprint.twist_limits(settings.robot)
            wanted = outside(wanted, limits, settings.control_period)
        key = wanted, settings.kept, settings.robot_radius
        if key not in self._searches:
            self._searches[key] = MapSearch(
                self._searchable, *key, self.searched.kept, self.searched.blocked
            )
        return self._searches[key]

    @cached_property
    def _searchable(self) -> tuple[Shape, ...]:
        seen = self.searched.seen
        return self.obstacles if seen is None else (*self.obstacles, seen)

    @cached_property
    def _spaces(self) -> dict[tuple[float, object], FreeSpace]:
        return {}

    @cached_property
    def _searches(self) -> dict[tuple[float, float, float], MapSearch]:
        return {}


@dataclass(frozen=True)
class GuidanceSettings(LawSettings):
    """A task as a person gives it: the numbers, and the road and obstacles that are known."""

    road: Road = field(kw_only=True)
    obstacles: tuple[Shape, ...] = field(default=(), kw_only=True)

    @cached_property
    def world(self) -> World:
        """The world as it is known before anything is seen."""
        return World(self.road, self.obstacles)


def _are_equal(one: Shape, other: Shape) -> bool:
    if isinstance(one, GridObstacle) and isinstance(other, GridObstacle):
        return one.name == other.name and one.grid.equals(other.grid)
    return one == other
