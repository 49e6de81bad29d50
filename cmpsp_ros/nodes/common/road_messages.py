"""Roads as messages."""

from __future__ import annotations

from typing import TYPE_CHECKING

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path

if TYPE_CHECKING:
    from cmpsp_ros.parameters import Values


def path_of(values: Values) -> Path:
    """The message of a corridor; `cmpsp_ros.parameters.courses.road_messages` reads it.

    Args:
        values: Parameters with at least one point.
    """
    numbers = values['road.points']
    points = list(zip(numbers[::2], numbers[1::2], strict=True))
    message = Path()
    message.header.frame_id = values['frame_id']
    for x, y in [*points, *(points[:1] if values['road.closed'] else ())]:
        pose = PoseStamped(header=message.header)
        pose.pose.position.x, pose.pose.position.y = x, y
        message.poses.append(pose)
    return message
