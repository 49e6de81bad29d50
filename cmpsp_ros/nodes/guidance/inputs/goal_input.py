"""Goals that come while the node is active: on a topic, and as actions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from geometry_msgs.msg import PoseStamped

from cmpsp_ros.guidance import Goal, GoalError
from cmpsp_ros.nodes.common.topics import GOAL_POSE
from cmpsp_ros.nodes.guidance.inputs.goal_actions import FOLLOW, NAVIGATE, GoalActions

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from rclpy.lifecycle import LifecycleNode

    from cmpsp_ros.guidance import Decision, GuidanceLaw
    from cmpsp_ros.nodes.guidance.inputs.road_input import RoadInput
    from cmpsp_ros.nodes.guidance.inputs.transform_input import TransformInput

_CANCELLED, _NONE_YET = 'The goal was cancelled.', 'No goal has come yet (goal.wait).'


class GoalInput:
    """Tells the law of goals.

    Attributes:
        cancelled: Why the robot is to stand until the next goal; empty where it is not.
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
        """Open topic and actions.

        Args:
            node: The node.
            law: Is told of the goals.
            transforms: Lead to the frame of the course.
            road: May be changed by the path of an action.
            is_active: Whether the robot is guided.
            waits: Whether the robot stands until the first goal of a run.
        """
        self._node, self._law, self._transforms, self._road = node, law, transforms, road
        self._is_active, self._at_first = is_active, _NONE_YET if waits else ''
        self.cancelled = self._at_first
        self._subscription = GOAL_POSE.listen_on(node, self._on_message)
        drives = {NAVIGATE: self._navigate, FOLLOW: self._follow}
        self._actions = GoalActions(
            node, transforms.settings.frame_id, drives, self._deaf, self._cancel
        )

    def close(self) -> None:
        """Close topic and actions."""
        self._node.destroy_subscription(self._subscription)
        self._actions.close()

    def end(self, reason: str) -> None:
        """The run has ended, for a reason in a sentence."""
        self.cancelled = self._at_first
        self._actions.abort(reason)

    def note(self, decision: Decision, pose: Sequence[float]) -> None:
        """Tell the client of an action what was decided, at a pose [m, m, rad]."""
        self._actions.note(decision, pose, self._law.distance_to)

    def _on_message(self, message: PoseStamped) -> None:
        if why := self._deaf(NAVIGATE):
            self._node.get_logger().warning(f'goal_pose is not heard: {why}')
            return
        try:
            self._tell(message)
        except GoalError as error:
            self._node.get_logger().warning(f'goal_pose is refused: {error}')
        else:
            self._actions.abort('Another goal came on goal_pose.')

    def _tell(self, message: PoseStamped) -> Goal:
        stamp, goal = self._transforms.goal_of(message)
        self._law.tell(stamp, goal)
        self.cancelled = ''
        return goal

    def _navigate(self, request: Any) -> Goal:
        return self._tell(request.pose)

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
        return self._tell(end)

    def _cancel(self) -> None:
        self.cancelled = _CANCELLED

    def _deaf(self, name: str) -> str:
        if not self._is_active():
            return 'the node is inactive'
        return 'the node is waiting for a road' if self._road.waits and name != FOLLOW else ''
