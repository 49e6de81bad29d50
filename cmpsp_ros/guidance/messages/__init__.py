"""ROS messages as the guidance law takes them; nothing here imports ROS."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.guidance.messages.object_tracks import ObjectTracks, TrackFusion, without_robots
    from cmpsp_ros.guidance.messages.objects import is_relative
    from cmpsp_ros.guidance.messages.odometry_gate import Arrival, OdometryGate, motion_limits
    from cmpsp_ros.guidance.messages.poses import (
        OdometryError,
        OdometryReading,
        compose,
        goal_of,
        heading_of,
    )
    from cmpsp_ros.guidance.messages.tracks import (
        MovingObject,
        PeerTrajectory,
        TrackError,
        Tracks,
        check_track_age,
        read_keys,
        told_tracks_of,
        tracks_of,
    )
    from cmpsp_ros.guidance.messages.transforms import TransformError, Transforms
    from cmpsp_ros.sensing import Track

__getattr__, __all__ = lazy_exports(__name__, __file__)
