"""Models of robots: kinematics, Jacobians, limits."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.robots.acceleration import NO_RAMP, braking, least_scale, with_lag, within_ramp
    from cmpsp_ros.robots.ackermann import Ackermann
    from cmpsp_ros.robots.arcs import (
        REFERENCE_POINT,
        Arc,
        arc_ends,
        arc_from,
        arc_of_point,
        arc_part,
        arc_under,
        plain,
        point_of,
        reach_of,
        speeds_and_turns,
        with_side,
    )
    from cmpsp_ros.robots.custom import CustomRobot, ModelError, custom_robot
    from cmpsp_ros.robots.differential_drive import DifferentialDrive
    from cmpsp_ros.robots.footprint import DISC, Bodies, Footprint, Point, contains, covered, placed
    from cmpsp_ros.robots.kinematics import (
        Kinematics,
        arc_of,
        drive,
        fastest_wheel,
        put_gradients,
        roll_out,
        steer,
        within_limits,
    )
    from cmpsp_ros.robots.omnidirectional import Omnidirectional, mecanum, on_omni_wheels
    from cmpsp_ros.robots.robot import Robot, Signal, TwistLimits

__getattr__, __all__ = lazy_exports(__name__, __file__)
