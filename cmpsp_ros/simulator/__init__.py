"""A stand-in for the robot, without ROS: plant, wheel lag, slip, physics, measurement."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.simulator.body import Motion
    from cmpsp_ros.simulator.laser import Laser, Scan, cast, discs_of, edges_of
    from cmpsp_ros.simulator.measurement import OdometrySchedule
    from cmpsp_ros.simulator.people import People
    from cmpsp_ros.simulator.physics import mjcf
    from cmpsp_ros.simulator.plant import Plant, TwistError
    from cmpsp_ros.simulator.settings import (
        LaserSettings,
        OdometryErrors,
        PeopleSettings,
        Physics,
        PlantSettings,
        Walker,
    )

__getattr__, __all__ = lazy_exports(__name__, __file__)
