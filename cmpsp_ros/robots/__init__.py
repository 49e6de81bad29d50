"""Models of robots: kinematics, Jacobians, limits."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.robots.ackermann import Ackermann
    from cmpsp_ros.robots.custom import CustomRobot, ModelError, custom_robot
    from cmpsp_ros.robots.differential_drive import DifferentialDrive
    from cmpsp_ros.robots.footprint import Bodies, Footprint, contains, covered, placed
    from cmpsp_ros.robots.omnidirectional import Omnidirectional
    from cmpsp_ros.robots.robot import Robot, Signal, TwistLimits

__getattr__, __all__ = lazy_exports(__name__, __file__)
