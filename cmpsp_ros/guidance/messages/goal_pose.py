"""Goals that are received while the robot drives or stands, as messages."""

from __future__ import annotations

import math
from typing import Any, Final

from cmpsp_ros.guidance.goals import Goal, GoalError
from cmpsp_ros.guidance.messages.checks import check_frame, is_place
from cmpsp_ros.guidance.messages.odometry import heading_of, stamp_of

RECEIVED: Final = 'goal_pose'
"""Name of a goal that is received while the robot drives or stands."""


def goal_of(message: Any, frame_id: str) -> tuple[int, Goal]:
    """Time stamp [ns] and goal of a PoseStamped; its time is not known yet.

    An orientation of zeros means any heading.

    Raises:
        GoalError: It is in another frame, is not finite, or has an orientation that is none.
    """
    check_frame('The goal is', message, frame_id, GoalError)
    position, q = message.pose.position, message.pose.orientation
    length = math.hypot(q.x, q.y, q.z, q.w)
    heading = None if length == 0.0 else heading_of(q)
    values = (position.x, position.y, heading or 0.0, length)
    if not all(map(math.isfinite, values)):
        raise GoalError(f'The goal is not finite: {[position.x, position.y, heading]}.')
    if not is_place(position.x, position.y):
        raise GoalError(
            f'The goal is at {position.x:.3g}, {position.y:.3g} m, wanted one on Earth.'
        )
    if heading is not None and abs(length - 1.0) > 0.01:
        raise GoalError(
            f'The goal has an orientation of length {length:.3g}, wanted 1, or 0 for any.'
        )
    return stamp_of(message), Goal((position.x, position.y), 0.0, heading, RECEIVED)
