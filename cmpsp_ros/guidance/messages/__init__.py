"""ROS messages as the law takes them and as it is written down; nothing here imports ROS."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.guidance.messages.goal_pose import goal_of
    from cmpsp_ros.guidance.messages.odometry import OdometryError, heading_of, pose_of, stamp_of
    from cmpsp_ros.guidance.messages.odometry_gate import Arrival, OdometryGate, motion_limits
    from cmpsp_ros.guidance.messages.peer_trajectories import (
        PeerTrajectory,
        Seen,
        plan_of,
        plan_topic,
    )
    from cmpsp_ros.guidance.messages.tracks import (
        FLOATS,
        Track,
        TrackError,
        Tracks,
        check_age,
        read_keys,
        tracks_of,
    )
    from cmpsp_ros.guidance.messages.transforms import TransformError, Transforms, compose

__getattr__, __all__ = lazy_exports(__name__, __file__)
