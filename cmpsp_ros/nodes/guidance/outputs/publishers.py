"""The topics that the guidance node publishes on while it is configured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from rclpy.lifecycle import LifecycleNode
from sensor_msgs.msg import JointState

from cmpsp_ros.guidance import Decision, Goal, GuidanceSettings, LawSettings, World
from cmpsp_ros.nodes.common import topics
from cmpsp_ros.nodes.common.health import hardware_id
from cmpsp_ros.nodes.common.messages import BASE, set_stamp
from cmpsp_ros.nodes.common.topic import Topic
from cmpsp_ros.nodes.guidance.outputs.listeners import Listeners
from cmpsp_ros.nodes.guidance.outputs.markers import PlanMarkers, marker_array
from cmpsp_ros.nodes.guidance.outputs.messages import (
    DecisionMessage,
    PathMessage,
    frame_bytes,
    polygon_message,
    stamped_bytes,
    twist_bytes,
)
from cmpsp_ros.parameters import Values


class GuidanceOutputs:
    """Publishers of one configured guidance node, and the `listeners` that a run waits for.

    The command leaves before anything else is made or sent.
    """

    def __init__(self, node: LifecycleNode, values: Values, settings: GuidanceSettings) -> None:
        """Create all publishers; the command's is silent unless the node is active."""
        self._node = node

        # Where time stands still until it is answered nothing grows stale, and all is recorded.
        def of_a_run(topic: Topic) -> Topic:
            return replace(topic, depth=topics.OF_A_RUN) if values['lockstep'] else topic

        self._topic = topics.STAMPED_COMMAND if values['enable_stamped_cmd_vel'] else topics.COMMAND
        command = of_a_run(self._topic)
        self._command = node.create_lifecycle_publisher(command.type, command.name, command.qos)
        self._wheels = topics.WHEELS.publish_on(node)
        self._decisions = of_a_run(topics.DECISION).publish_on(node)
        self._path = topics.PLAN.publish_on(node)
        self._plan_markers = topics.PLAN_MARKERS.publish_on(node)
        self._corners = topics.FOOTPRINT.publish_on(node)
        self._markers = topics.MARKERS.publish_on(node)
        self.listeners = Listeners(
            node, self._command, (self._wheels, self._decisions), values['recorder_timeout']
        )
        self._robot_frame = BASE, frame_bytes(BASE)
        self._footprint, self._frame_id = settings.footprint, settings.frame_id
        name = f'{node.get_fully_qualified_name()}: decision'
        self._wheel_message = JointState(name=values['robot.joint_names'])
        self._decision_message = DecisionMessage(name, hardware_id(node), self._frame_id)
        self._path_message = PathMessage(self._frame_id)
        self._plan_message = PlanMarkers(settings)

    @property
    def subscribers(self) -> dict[str, int]:
        """Numbers of subscribers to the topics of every decision, for diagnostics."""
        publishers = {
            'command': self._command,
            'decision': self._decisions,
            'path': self._path,
            'wheel': self._wheels,
        }
        return {
            f'{name}_subscribers': int(each.get_subscription_count())
            for name, each in publishers.items()
        }

    def command(self, decision: Decision) -> None:
        """Send the command of a decision, stamped as the odometry that it answers."""
        if self._topic is topics.STAMPED_COMMAND:
            self._command.publish(stamped_bytes(decision, self._robot_frame[1]))
        else:
            self._command.publish(twist_bytes(decision))

    def name_robot(self, frame: str) -> None:
        """Name the robot's frame, of commands that are stamped; `base_link` where unknown."""
        if frame != self._robot_frame[0]:
            self._robot_frame = frame, frame_bytes(frame or BASE)

    def report(self, decision: Decision, pose: Sequence[float]) -> None:
        """Send a decision; path and markers only if somebody listens.

        The pose of the robot (x, y, heading) [m, m, rad] is empty where it is unknown.
        """
        self._wheel_message.velocity = decision.wheel_speeds.tolist()
        set_stamp(self._wheel_message.header, decision.stamp)
        self._wheels.publish(self._wheel_message)
        self._decisions.publish(self._decision_message.fill(decision))
        if self._path.get_subscription_count():
            if decision.plan is not None:
                self._path.publish(self._path_message.fill(decision.plan, decision.stamp))
            elif len(pose):
                self._path.publish(self._path_message.stand(pose, decision.stamp))
        if self._plan_markers.get_subscription_count():
            self._plan_markers.publish(self._plan_message.fill(decision))
        if self._footprint.corners and len(pose) and self._corners.get_subscription_count():
            corners = self._footprint.at(np.array(pose))
            self._corners.publish(polygon_message(corners, self._frame_id, decision.stamp))

    def show(self, settings: LawSettings, world: World, ahead: Goal | None) -> None:
        """Send road, obstacles and goals, paler before the goal ahead.

        They are latched: late subscribers receive them, too.
        """
        now = self._node.get_clock().now().to_msg()
        self._markers.publish(marker_array(settings, world, now, ahead))
        self._plan_message.take(settings, world)
        self._footprint = settings.footprint

    def close(self) -> None:
        """Destroy all publishers."""
        self._node.destroy_lifecycle_publisher(self._command)
        markers = self._corners, self._plan_markers, self._markers
        reports = (self._wheels, self._decisions, self._path, *markers)
        for publisher in reports:
            self._node.destroy_publisher(publisher)
