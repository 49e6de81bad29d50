"""Goals that are received: on a topic, and as Nav2's actions where `nav2_msgs` is installed."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import PoseStamped
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.lifecycle import LifecycleNode
from rclpy.task import Future

from cmpsp_ros.guidance import NANOSECONDS, Decision, Goal, GoalError, GuidanceLaw
from cmpsp_ros.guidance.messages import TransformError
from cmpsp_ros.nodes.common.messages import set_pose
from cmpsp_ros.nodes.common.topic import Listener
from cmpsp_ros.nodes.common.topics import GOAL_POSE
from cmpsp_ros.nodes.guidance.inputs.course import RoadInput
from cmpsp_ros.nodes.guidance.inputs.transforms import TransformInput
from cmpsp_ros.robots.motion import speeds_and_turns

try:
    from nav2_msgs.action import FollowPath, NavigateToPose
except ImportError:  # Nav2 is not among the wheels
    FollowPath = NavigateToPose = None

NAVIGATE, FOLLOW = 'navigate_to_pose', 'follow_path'

_CANCELLED, _NONE_YET = 'The goal was cancelled.', 'No goal has come yet (goal.wait).'

# Error codes of FollowPath in Jazzy: NONE, UNKNOWN, TF_ERROR, INVALID_PATH and
# FAILED_TO_MAKE_PROGRESS. NavigateToPose has none of its own there: Nav2 hands on those of a path.
_CODES = {'': 0, 'unknown': 100, 'transform': 102, 'refused': 103, 'missed': 105}


class _Running(NamedTuple):
    """A goal that is driven to."""

    name: str
    handle: ServerGoalHandle
    goal: Goal
    begun: int
    ended: Future


class GoalInput(Listener):
    """Gives received goals to the law; `cancelled` is a reason to stand until the next one.

    Of the goals of both actions the newest is driven to. One is rejected where none is
    accepted; one that cannot be driven to is aborted, with the reason. With `waits` the robot
    stands until the first goal of a run.
    """

    def __init__(
        self,
        node: LifecycleNode,
        law: GuidanceLaw,
        transforms: TransformInput,
        road: RoadInput,
        is_active: Callable[[], bool],
        *,
        waits: bool,
    ) -> None:
        super().__init__(node)
        self._law, self._transforms, self._road = law, transforms, road
        self._is_active, self._at_first = is_active, _NONE_YET if waits else ''
        self.cancelled = self._at_first
        self._running: _Running | None = None
        self._subscriptions.append(GOAL_POSE.listen_on(node, self._on_message))
        kinds = (NAVIGATE, NavigateToPose, self._navigate), (FOLLOW, FollowPath, self._follow)
        self._servers = [
            ActionServer(
                node,
                kind,
                name,
                partial(self._execute, name, kind, drive),
                goal_callback=partial(self._on_request, name),
                cancel_callback=self._on_cancel,
            )
            for name, kind, drive in kinds
            if kind is not None
        ]

    def close(self) -> None:
        """Close topic and actions."""
        super().close()
        for each in self._servers:
            each.destroy()

    def end(self, reason: str) -> None:
        """End the run for a reason in a sentence."""
        self.cancelled = self._at_first
        self._abort(reason)

    def note(self, decision: Decision, pose: Sequence[float]) -> None:
        """Report a decision at a pose [m, m, rad] to the client; end its goal if that is due."""
        running = self._running
        if running is None:
            return
        if running.handle.is_cancel_requested:
            if (decision.cancelled or decision.halted) and not np.any(decision.twist):
                self._finish(running.handle.canceled, '', decision.reason)
            return
        ours = decision.goal is not None and decision.goal.position == running.goal.position
        if ours and decision.finished and not decision.halted:
            if decision.missed:
                self._finish(running.handle.abort, 'missed', decision.reason)
            else:
                self._finish(running.handle.succeed, '', '')
        elif ours and len(pose):
            running.handle.publish_feedback(self._feedback(running, decision, pose))

    def _on_message(self, message: PoseStamped) -> None:
        if why := self._rejection_reason(NAVIGATE):
            self._node.get_logger().warning(f'goal_pose is not heard: {why}')
            return
        try:
            self._set_goal(message)
        except GoalError as error:
            self._node.get_logger().warning(f'goal_pose is refused: {error}')
        else:
            self._abort('Another goal came on goal_pose.')

    def _set_goal(self, message: PoseStamped) -> Goal:
        stamp, goal = self._transforms.goal_of(message)
        self._law.set_goal(stamp, goal)
        self.cancelled = ''
        return goal

    def _navigate(self, request: Any) -> Goal:
        return self._set_goal(request.pose)

    def _follow(self, request: Any) -> Goal:
        """Make a path the road, and its end the goal."""
        end = PoseStamped()
        end.header.frame_id = self._transforms.settings.frame_id
        try:
            x, y = self._road.drive_along(request.path)
        except ValueError as error:
            reason = ' '.join(str(error).splitlines())
            raise GoalError(f'The path is refused: {reason}.') from error.__cause__
        end.pose.position.x, end.pose.position.y, end.pose.orientation.w = x, y, 0.0
        return self._set_goal(end)

    def _rejection_reason(self, name: str) -> str:
        if not self._is_active():
            return 'the node is inactive'
        return 'the node is waiting for a road' if self._road.waits and name != FOLLOW else ''

    def _on_request(self, name: str, _request: Any) -> GoalResponse:
        if why := self._rejection_reason(name):
            self._node.get_logger().warning(f'{name} is rejected: {why}')
            return GoalResponse.REJECT
        return GoalResponse.ACCEPT

    def _on_cancel(self, handle: ServerGoalHandle) -> CancelResponse:
        if self._running is None or self._running.handle.goal_id != handle.goal_id:
            return CancelResponse.REJECT
        self.cancelled = _CANCELLED
        return CancelResponse.ACCEPT

    async def _execute(
        self, name: str, kind: Any, drive: Callable[[Any], Goal], handle: ServerGoalHandle
    ) -> Any:
        try:
            goal = drive(handle.request)
        except GoalError as error:
            self._node.get_logger().warning(f'{name} is aborted: {error}')
            cause = 'transform' if isinstance(error.__cause__, TransformError) else 'refused'
            handle.abort()
            return result(kind, _CODES[cause], str(error))
        self._abort('Another goal came.')
        begun = self._node.get_clock().now().nanoseconds
        running = self._running = _Running(name, handle, goal, begun, Future())
        end, cause, reason = await running.ended
        end()
        return result(kind, _CODES[cause], reason)

    def _abort(self, reason: str) -> None:
        """End the goal that is driven to, if there is one, for a reason in a sentence."""
        if self._running is not None:
            self._finish(self._running.handle.abort, 'unknown', reason)

    def _finish(self, end: Callable[[], None], cause: str, reason: str) -> None:
        running, self._running = self._running, None
        if running is not None:
            running.ended.set_result((end, cause, reason))

    def _feedback(self, running: _Running, decision: Decision, pose: Sequence[float]) -> Any:
        here, now = PoseStamped(), self._node.get_clock().now()
        here.header.frame_id = self._transforms.settings.frame_id
        here.header.stamp = now.to_msg()
        set_pose(here.pose, pose)
        far = self._law.distance_to(pose, running.goal)
        if running.name == FOLLOW:
            return path_feedback(here, far, float(speeds_and_turns(decision.twist)[0]))
        return NavigateToPose.Feedback(
            current_pose=here,
            navigation_time=_duration((now.nanoseconds - running.begun) / NANOSECONDS),
            estimated_time_remaining=_duration(decision.time_left),
            distance_remaining=far,
        )


def _duration(seconds: float) -> Duration:
    sec, nanosec = divmod(round(max(0.0, seconds) * NANOSECONDS), NANOSECONDS)
    return Duration(sec=sec, nanosec=nanosec)


def path_feedback(pose: PoseStamped, distance: float, speed: float) -> Any:
    """Feedback of FollowPath: distance [m] to the goal along the path, and speed [m/s].

    From Lyrical on they are fields of a message `nav2_msgs/TrackingFeedback`, beside the pose.
    """
    feedback = FollowPath.Feedback()
    values = getattr(feedback, 'tracking_feedback', feedback)
    values.distance_to_goal, values.speed = distance, speed
    if values is not feedback:
        values.header, values.robot_pose = pose.header, pose
        values.remaining_path_length = distance
    return feedback


def result(kind: Any, code: int, reason: str) -> Any:
    """Result of an action; Jazzy had no text at first."""
    found = kind.Result()
    for field, value in (('error_code', code), ('error_msg', reason)):
        if hasattr(found, field):
            setattr(found, field, value)
    return found
