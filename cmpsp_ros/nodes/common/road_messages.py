"""Roads as messages: the centre line of a corridor as `nav_msgs/Path`.

As with a road file, a message is converted to parameters. The guidance node changes these, so a
bag contains the road itself, and from which decision on it was in force.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path

from cmpsp_ros.parameters import ParameterError, Problem, describe

if TYPE_CHECKING:
    from cmpsp_ros.parameters import Values

TOPIC: Final = 'road'

_MAX_POINTS: Final = 10_000


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
    """The parameters of a road in a message.

    A line that ends where it begins is a closed road. Heights and orientations are ignored.

    Args:
        message: A Path.
        frame_id: Frame of the road. A pose may leave its own empty.

    Returns:
        Values by key; the road itself is not checked.

    Raises:
        ParameterError: It is in another frame, has no points or too many, or one is not finite;
            names the point.
    """
    _check_frame(TOPIC, message.header.frame_id, frame_id)
    if not 0 < len(message.poses) <= _MAX_POINTS:
        found, wanted = f'{len(message.poses)} points', f'some, and {_MAX_POINTS} at most'
        raise ParameterError(Problem(TOPIC, found, wanted))
    points = []
    for index, each in enumerate(message.poses):
        where = f'{TOPIC}, point {index} (from 0)'
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
