"""Sensors: messages in, beams and a local grid out."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.sensing.beams import Beams, ScanError, Sensor, Sight, SightSettings
    from cmpsp_ros.sensing.grid_messages import REMEMBERED, grid_of, updated
    from cmpsp_ros.sensing.local_grid import LocalGrid
    from cmpsp_ros.sensing.messages import FARTHEST, is_place, points_of, sight_of, stamp_of
    from cmpsp_ros.sensing.motion_filter import MotionFilter
    from cmpsp_ros.sensing.projection import projected
    from cmpsp_ros.sensing.surroundings import Sighting, Surroundings
    from cmpsp_ros.sensing.track import Track, TrackSource

__getattr__, __all__ = lazy_exports(__name__, __file__)
