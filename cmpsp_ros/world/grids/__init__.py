"""Occupied, free and unknown cells: grids, their files, and distances to occupied cells."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.world.grids.cell_groups import small_groups
    from cmpsp_ros.world.grids.distance_transform import distance_field
    from cmpsp_ros.world.grids.field_functions import NO_FIELD, DistanceField, Fields
    from cmpsp_ros.world.grids.grid_obstacle import GridObstacle
    from cmpsp_ros.world.grids.grid_search import (
        NARROW,
        cells_from,
        costs_of,
        evenly_spaced,
        lengths_to,
    )
    from cmpsp_ros.world.grids.occupancy_grid import (
        Cell,
        Cells,
        GridError,
        OccupancyGrid,
        check_size,
        is_free,
    )

__getattr__, __all__ = lazy_exports(__name__, __file__)
