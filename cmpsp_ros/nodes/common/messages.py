"""Poses, moving obstacles and roads as ROS messages."""

import math
import struct
from collections.abc import Iterable, Sequence
from typing import Any, Final

from geometry_msgs.msg import Pose, PoseStamped, Quaternion
from nav_msgs.msg import Path
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from cmpsp_ros.guidance import NANOSECONDS
from cmpsp_ros.guidance.messages import Track
from cmpsp_ros.parameters import ParameterError, Problem, Values, describe

BASE: Final = 'base_link'  # frame of a robot whose odometry does not name it
ROAD: Final = 'road'
_MAX_POINTS: Final = 10_000


def set_stamp(header: Header, stamp_ns: int) -> None:
    """Stamp a message [ns]."""
    header.stamp.sec, header.stamp.nanosec = divmod(stamp_ns, NANOSECONDS)


def rotation_of(heading: float) -> Quaternion:
    """Orientation of a heading [rad]."""
    return Quaternion(x=0.0, y=0.0, z=math.sin(heading / 2.0), w=math.cos(heading / 2.0))


def set_pose(message: Pose, pose: Iterable[float]) -> None:
    """Set a pose (x, y, heading) [m, m, rad]."""
    message.position.x, message.position.y, heading = pose
    message.orientation = rotation_of(heading)


def cloud_of(tracks: Sequence[Track], stamp_ns: int, frame_id: str) -> PointCloud2:
    """Moving obstacles as a message, exactly; RViz shows only points that have a z."""
    signed = any(each.id < 0 for each in tracks)
    doubts = tuple(name for name in Track.DOUBTS if any(getattr(each, name) for each in tracks))
    floats = (*Track.FIELDS, *doubts)
    point = struct.Struct(f'<{len(floats) + 1}d{"i" if signed else "I"}')
    message = PointCloud2(height=1, width=len(tracks), is_dense=True, is_bigendian=False)
    set_stamp(message.header, stamp_ns)
    message.header.frame_id = frame_id
    kinds = [PointField.FLOAT64] * (len(floats) + 1)
    kinds.append(PointField.INT32 if signed else PointField.UINT32)
    message.fields = [
        PointField(name=name, offset=8 * place, datatype=kind, count=1)
        for place, (name, kind) in enumerate(zip((*floats, 'z', 'id'), kinds, strict=True))
    ]
    message.point_step = point.size
    message.row_step = point.size * len(tracks)
    message.data = b''.join(
        point.pack(*(getattr(each, name) for name in floats), 0.0, each.id) for each in tracks
    )
    return message


def path_of(values: Values) -> Path:
    """The message of a corridor with at least one point."""
    numbers = values['road.points']
    points = list(zip(numbers[::2], numbers[1::2], strict=True))
    message = Path()
    message.header.frame_id = values['frame_id']
    for x, y in [*points, *(points[:1] if values['road.closed'] else ())]:
        pose = PoseStamped(header=message.header)
        pose.pose.position.x, pose.pose.position.y = x, y
        message.poses.append(pose)
    return message


def road_in(message: Any, frame_id: str) -> dict[str, Any]:
    """The parameters of a road in a `nav_msgs/Path`, by key; the road itself is not checked.

    A line that ends where it begins is closed. Raises ParameterError for another frame (a pose
    may leave its own empty), no points or too many, or one that is not finite.
    """
    _check_frame(ROAD, message.header.frame_id, frame_id)
    if not 0 < len(message.poses) <= _MAX_POINTS:
        found, wanted = f'{len(message.poses)} points', f'some, and {_MAX_POINTS} at most'
        raise ParameterError(Problem(ROAD, found, wanted))
    points = []
    for index, each in enumerate(message.poses):
        where = f'{ROAD}, point {index} (from 0)'
        _check_frame(where, each.header.frame_id or frame_id, frame_id)
        place = each.pose.position.x, each.pose.position.y
        if not all(map(math.isfinite, place)):
            raise ParameterError(Problem(where, describe(list(place)), 'finite numbers [m]'))
        points.append(place)
    closed = len(points) > 1 and points[0] == points[-1]
    kept = points[:-1] if closed else points
    return {'road.points': [number for place in kept for number in place], 'road.closed': closed}


def _check_frame(where: str, found: str, wanted: str) -> None:
    if found != wanted:
        raise ParameterError(Problem(where, f'frame {found!r}', f'{wanted!r} (frame_id)'))
