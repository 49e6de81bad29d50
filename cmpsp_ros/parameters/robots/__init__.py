"""Parameters of the robot: its model and limits, its footprint, and its sensors."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.parameters.robots.models import robot_of
    from cmpsp_ros.parameters.robots.scans import OWN_OBSTACLES, laser_settings

__getattr__, __all__ = lazy_exports(__name__, __file__)
