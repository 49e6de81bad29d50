"""Roads in messages: the centre line of a corridor as `nav_msgs/Path`.

As with a road file, the message is converted to parameters. The guidance node changes these, so a
bag contains the road itself, and from which decision on it was in force.
"""

from __future__ import annotations

import math
from typing import Any, Final

from cmpsp_ros.parameters.errors import ParameterError, Problem, describe

TOPIC: Final = 'road'

_MOST: Final = 10_000


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
    if not 0 < len(message.poses) <= _MOST:
        found, wanted = f'{len(message.poses)} points', f'some, and {_MOST} at most'
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
