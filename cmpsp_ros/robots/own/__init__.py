"""Models of one's own."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.robots.own.functions import steer
    from cmpsp_ros.robots.own.loading import ModelError, own_model, own_robot
    from cmpsp_ros.robots.own.robot import OwnRobot

__getattr__, __all__ = lazy_exports(__name__, __file__)
