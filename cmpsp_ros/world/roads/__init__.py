"""Roads: edges to stay between, and a centre line to follow."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.world.roads.annulus import Annulus
    from cmpsp_ros.world.roads.corridor import Corridor, RoadError
    from cmpsp_ros.world.roads.road import (
        OpenFloor,
        Point,
        Road,
        arc_length_to,
        find_near,
        lookahead_point,
        lookahead_points,
        project_on_path,
        remaining_arc_length,
    )
    from cmpsp_ros.world.roads.road_functions import FAR, RoadSpace

__getattr__, __all__ = lazy_exports(__name__, __file__)


def kinds() -> 'list[type[Road]]':
    """All kinds of road."""
    from cmpsp_ros.world.roads.road import Road  # noqa: PLC0415 (loads numba)

    offered = (__getattr__(name) for name in __all__)
    return [each for each in offered if isinstance(each, type) and Road in each.__bases__]
