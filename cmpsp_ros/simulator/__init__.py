"""A stand-in for the robot, without ROS: plant, wheel lag, slip, physics, measurement."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.simulator.body import Motion
    from cmpsp_ros.simulator.laser import Laser, LaserSettings, Scan
    from cmpsp_ros.simulator.measurement import OdometryErrors
    from cmpsp_ros.simulator.odometry_schedule import OdometrySchedule
    from cmpsp_ros.simulator.physics import Physics, mjcf
    from cmpsp_ros.simulator.plant import Plant, PlantSettings, TwistError
    from cmpsp_ros.simulator.ray_casting import cast, discs_of, edges_of

__getattr__, __all__ = lazy_exports(__name__, __file__)
