"""Goals that are told under way: what of a message the law is told, and what is refused."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from cmpsp_ros.guidance.messages.odometry import FARTHEST, heading_of, stamp_of
from cmpsp_ros.guidance.mission.goal_manager import TOLD
from cmpsp_ros.guidance.mission.goals import Goal
from cmpsp_ros.guidance.safety.audit import Audit
from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.world.roads.corridor import Corridor

_ROUNDING = 1e-9


class GoalError(ValueError):
    """A goal that is not driven to; the message says why."""


def goal_of(message: Any, frame_id: str) -> tuple[int, Goal]:
    """Time stamp [ns] and goal of a PoseStamped; its time is not known yet.

    An orientation of zeros means any heading.

    Raises:
        GoalError: It is in another frame, is not finite, or has an orientation that is none.
    """
    if message.header.frame_id != frame_id:
        raise GoalError(
            f'The goal is in frame {message.header.frame_id!r}, wanted {frame_id!r} (frame_id).'
        )
    position, q = message.pose.position, message.pose.orientation
    length = math.hypot(q.x, q.y, q.z, q.w)
    heading = None if length == 0.0 else heading_of(q)
    values = (position.x, position.y, heading or 0.0, length)
    if not all(map(math.isfinite, values)):
        raise GoalError(f'The goal is not finite: {[position.x, position.y, heading]}.')
    if not max(abs(position.x), abs(position.y)) <= FARTHEST:
        raise GoalError(
            f'The goal is at {position.x:.3g}, {position.y:.3g} m, wanted one on Earth.'
        )
    if heading is not None and abs(length - 1.0) > 0.01:
        raise GoalError(
            f'The goal has an orientation of length {length:.3g}, wanted 1, or 0 for any.'
        )
    return stamp_of(message), Goal((position.x, position.y), 0.0, heading, TOLD)


def check_goal(settings: GuidanceSettings, audit: Audit, goal: Goal) -> None:
    """Refuse a goal that the robot cannot stand at.

    Raises:
        GoalError: It is off the road or in an obstacle, or a road is followed.
    """
    if settings.follow is not None:
        raise GoalError('The robot follows the road without end (follow.speed): it takes no goal.')
    x, y = goal.position
    away = audit.at(np.array([x, y, math.nan]))
    nearest = int(away.argmin())
    if away[nearest] < -_ROUNDING:
        name = audit.names([nearest])
        raise GoalError(f'The goal is {-away[nearest]:.3g} m inside or beyond {name}.')
    if isinstance(settings.road, Corridor) and settings.road.beyond(goal.position) > _ROUNDING:
        beyond = settings.road.beyond(goal.position)
        raise GoalError(f'The goal is {beyond:.3g} m beyond the end of the road.')
