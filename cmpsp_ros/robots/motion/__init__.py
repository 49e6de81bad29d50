"""Arcs and controls of any robot, most of it for compiled code: motion, distances, ramps, lag."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.robots.motion.acceleration import (
        NO_RAMP,
        braking,
        least_scale,
        smoothed,
        with_lag,
        within_ramp,
    )
    from cmpsp_ros.robots.motion.arcs import (
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
    from cmpsp_ros.robots.motion.kinematics import (
        Kinematics,
        arc_of,
        drive,
        fastest_wheel,
        lateral_acceleration,
        put_gradients,
        put_lateral_gradient,
        roll_out,
        steer,
        within_limits,
    )

__getattr__, __all__ = lazy_exports(__name__, __file__)
