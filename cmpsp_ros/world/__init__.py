"""The space of a robot: roads, obstacles, free space, and the margin between samples."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.world.free_space import FreeSpace, SpaceData
    from cmpsp_ros.world.inter_sample_margin import at_ends, outside
    from cmpsp_ros.world.map_line import KeptLine, MapSearch, is_beside

__getattr__, __all__ = lazy_exports(__name__, __file__)
