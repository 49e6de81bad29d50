"""Goals as Nav2's actions `navigate_to_pose` and `follow_path`, where `nav2_msgs` is installed."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import PoseStamped
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.task import Future

from cmpsp_ros.guidance import NANOSECONDS, Goal, GoalError
from cmpsp_ros.guidance.messages import TransformError
from cmpsp_ros.robots import speeds_and_turns

try:
    from nav2_msgs.action import FollowPath, NavigateToPose
except ImportError:  # Nav2 is not among the wheels
    FollowPath = NavigateToPose = None

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Sequence

    from rclpy.action.server import ServerGoalHandle
    from rclpy.lifecycle import LifecycleNode

    from cmpsp_ros.guidance import Decision

NAVIGATE, FOLLOW = 'navigate_to_pose', 'follow_path'

_CODES = {'': 0, 'unknown': 100, 'transform': 102, 'refused': 103, 'missed': 105}
"""Error codes of FollowPath in Jazzy: NONE, UNKNOWN, TF_ERROR, INVALID_PATH and
FAILED_TO_MAKE_PROGRESS. NavigateToPose has none of its own there: Nav2 hands on those of a path."""


class _Running(NamedTuple):
    """A goal that is driven to."""

    name: str
    handle: ServerGoalHandle
    goal: Goal
    begun: int
    ended: Future


class GoalActions:
    """Servers of both actions; one goal is driven to at a time, and the newest counts.

    A goal is rejected where no goal is heard. One that is accepted and cannot be driven to is
    aborted, with the reason.
    """

    def __init__(
        self,
        node: LifecycleNode,
        frame_id: str,
        drives: Mapping[str, Callable[[Any], Goal]],
        deaf: Callable[[str], str],
        cancel: Callable[[], None],
    ) -> None:
        """Offer the actions, where they can be.

        Args:
            node: The node.
            frame_id: Frame of the course.
            drives: Takes a request of each action; raises GoalError.
            deaf: Why requests of an action are not heard now; empty where they are.
            cancel: Stops the robot.
        """
        self._node, self._frame_id, self._deaf, self._cancel = node, frame_id, deaf, cancel
        self._running: _Running | None = None
        self._servers: list[ActionServer] = []
        if NavigateToPose is not None:
            self._servers = [
                ActionServer(
                    node,
                    kind,
                    name,
                    partial(self._execute, name, kind, drives[name]),
                    goal_callback=partial(self._on_request, name),
                    cancel_callback=self._on_cancel,
                )
                for name, kind in ((NAVIGATE, NavigateToPose), (FOLLOW, FollowPath))
            ]

    def close(self) -> None:
        """Withdraw the actions."""
        for each in self._servers:
            each.destroy()

    def abort(self, reason: str) -> None:
        """End the goal that is driven to, if there is one, for a reason in a sentence."""
        if self._running is not None:
            self._end(self._running.handle.abort, 'unknown', reason)

    def note(
        self,
        decision: Decision,
        pose: Sequence[float],
        distance: Callable[[Sequence[float], Goal], float],
    ) -> None:
        """Tell the client what was decided, and end its goal where that is due.

        Args:
            decision: The decision.
            pose: Where the robot is (x, y, heading) [m, m, rad].
            distance: From a pose to a goal [m].
        """
        running = self._running
        if running is None:
            return
        if running.handle.is_cancel_requested:
            if decision.cancelled and not np.any(decision.twist):
                self._end(running.handle.canceled, '', decision.reason)
            return
        ours = decision.goal is not None and decision.goal.position == running.goal.position
        if ours and decision.finished and not decision.halted:
            if decision.missed:
                self._end(running.handle.abort, 'missed', decision.reason)
            else:
                self._end(running.handle.succeed, '', '')
        elif ours and len(pose):
            far = distance(pose, running.goal)
            running.handle.publish_feedback(self._feedback(running, decision, pose, far))

    def _on_request(self, name: str, _request: Any) -> GoalResponse:
        if why := self._deaf(name):
            self._node.get_logger().warning(f'{name} is rejected: {why}')
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _on_cancel(self, handle: ServerGoalHandle) -> CancelResponse:
        if self._running is None or self._running.handle.goal_id != handle.goal_id:
            return CancelResponse.REJECT
        self._cancel()
        return CancelResponse.ACCEPT

    async def _execute(
        self, name: str, kind: Any, drive: Callable[[Any], Goal], handle: ServerGoalHandle
    ) -> Any:
        """Drive to a goal; its result."""
        try:
            goal = drive(handle.request)
        except GoalError as error:
            self._node.get_logger().warning(f'{name} is aborted: {error}')
            cause = 'transform' if isinstance(error.__cause__, TransformError) else 'refused'
            handle.abort()
            return _result(kind, cause, str(error))
        self.abort('Another goal came.')
        begun = self._node.get_clock().now().nanoseconds
        running = self._running = _Running(name, handle, goal, begun, Future())
        end, cause, reason = await running.ended
        end()
        return _result(kind, cause, reason)

    def _end(self, end: Callable[[], None], cause: str, reason: str) -> None:
        running, self._running = self._running, None
        if running is not None:
            running.ended.set_result((end, cause, reason))

    def _feedback(
        self, running: _Running, decision: Decision, pose: Sequence[float], far: float
    ) -> Any:
        if running.name == FOLLOW:
            return FollowPath.Feedback(
                distance_to_goal=far, speed=float(speeds_and_turns(decision.twist)[0])
            )
        here, now = PoseStamped(), self._node.get_clock().now()
        here.header.frame_id, here.header.stamp = self._frame_id, now.to_msg()
        x, y, heading = pose
        here.pose.position.x, here.pose.position.y = x, y
        here.pose.orientation.z = math.sin(heading / 2.0)
        here.pose.orientation.w = math.cos(heading / 2.0)
        return NavigateToPose.Feedback(
            current_pose=here,
            navigation_time=_duration((now.nanoseconds - running.begun) / NANOSECONDS),
            estimated_time_remaining=_duration(decision.time_left),
            distance_remaining=far,
        )


def _duration(seconds: float) -> Duration:
    sec, nanosec = divmod(round(max(0.0, seconds) * NANOSECONDS), NANOSECONDS)
    return Duration(sec=sec, nanosec=nanosec)


def _result(kind: Any, cause: str, reason: str) -> Any:
    result = kind.Result()
    # Which fields there are depends on the version of Nav2; Jazzy had no text at first.
    for field, value in (('error_code', _CODES[cause]), ('error_msg', reason)):
        if hasattr(result, field):
            setattr(result, field, value)
    return result
