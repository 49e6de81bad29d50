"""The topics that the guidance node publishes on while it is configured."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rclpy.time import Time

from cmpsp_ros.nodes.guidance_messages import (
    decision_message,
    joint_state_message,
    path_message,
    stamped_twist_message,
    twist_message,
)
from cmpsp_ros.nodes.markers import marker_array
from cmpsp_ros.nodes.topics import COMMAND, DECISION, MARKERS, PLAN, STAMPED_COMMAND, WHEELS

if TYPE_CHECKING:
    from rclpy.lifecycle import LifecycleNode

    from cmpsp_ros.guidance.decision import Decision
    from cmpsp_ros.guidance.settings import GuidanceSettings
    from cmpsp_ros.parameters.table import Values


class GuidanceOutputs:
    """Publishers of one configured guidance node.

    The command leaves before anything else is made or sent.
    """

    def __init__(self, node: LifecycleNode, values: Values) -> None:
        """Create all publishers; the command's is silent unless the node is active."""
        self._node = node
        self._frame_id: str = values['frame_id']
        self._joint_names: list[str] = values['robot.joint_names']
        self._stamped: bool = values['enable_stamped_cmd_vel']
        self._name = f'{node.get_fully_qualified_name()}: decision'
        command = STAMPED_COMMAND if self._stamped else COMMAND
        self._command = node.create_lifecycle_publisher(command.type, command.name, command.qos)
        self._wheels = WHEELS.publish_on(node)
        self._decisions = DECISION.publish_on(node)
        self._path = PLAN.publish_on(node)
        self._markers = MARKERS.publish_on(node)

    @property
    def command_subscribers(self) -> int:
        """How many listen to the commands."""
        return int(self._command.get_subscription_count())

    def command(self, decision: Decision) -> None:
        """Send the command of a decision."""
        if self._stamped:
            stamp = Time(nanoseconds=decision.stamp).to_msg()
            self._command.publish(stamped_twist_message(decision, stamp))
        else:
            self._command.publish(twist_message(decision))

    def report(self, decision: Decision) -> None:
        """Send what a decision was made of; the path only if somebody listens."""
        stamp = Time(nanoseconds=decision.stamp).to_msg()
        self._wheels.publish(joint_state_message(decision, self._joint_names, stamp))
        self._decisions.publish(decision_message(decision, self._name))
        if decision.plan is not None and self._path.get_subscription_count():
            self._path.publish(path_message(decision.plan, self._frame_id, decision.stamp))

    def show(self, settings: GuidanceSettings) -> None:
        """Send road, obstacles and goal to everybody, now and later."""
        now = self._node.get_clock().now().to_msg()
        self._markers.publish(marker_array(settings, now))

    def close(self) -> None:
        """Destroy all publishers."""
        self._node.destroy_lifecycle_publisher(self._command)
        for publisher in (self._wheels, self._decisions, self._path, self._markers):
            self._node.destroy_publisher(publisher)
