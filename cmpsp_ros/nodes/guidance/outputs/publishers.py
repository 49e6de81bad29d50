"""The topics that the guidance node publishes on while it is configured, and their listeners."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from rclpy.lifecycle import LifecycleNode
from rclpy.publisher import Publisher
from sensor_msgs.msg import JointState

from cmpsp_ros.guidance import Decision, Goal, GuidanceSettings, LawSettings, World
from cmpsp_ros.nodes.common import topics
from cmpsp_ros.nodes.common.health import hardware_id
from cmpsp_ros.nodes.common.messages import BASE, set_stamp
from cmpsp_ros.nodes.common.topic import Topic
from cmpsp_ros.nodes.common.topics import GUIDANCE_ODOM
from cmpsp_ros.nodes.guidance.outputs import messages
from cmpsp_ros.nodes.guidance.outputs.markers import PlanMarkers, marker_array
from cmpsp_ros.parameters import Values


class GuidanceOutputs:
    """Publishers of one configured guidance node, and the `listeners` that a run waits for.

    `seen` are publishers, by name, of the grid and the tracks that decisions use: a bag without
    them cannot be replayed.
    """

    def __init__(
        self,
        node: LifecycleNode,
        values: Values,
        settings: GuidanceSettings,
        seen: Mapping[str, Publisher],
    ) -> None:
        self._node, self._seen = node, seen

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
        reports = self._wheels, self._decisions, *seen.values()
        self.listeners = Listeners(node, self._command, reports, values['recorder_timeout'])
        self._robot_frame = BASE, messages.frame_bytes(BASE)
        self._footprint, self._frame_id = settings.footprint, settings.frame_id
        name = f'{node.get_fully_qualified_name()}: decision'
        self._wheel_message = JointState(name=values['robot.joint_names'])
        self._decision_message = messages.DecisionMessage(name, hardware_id(node), self._frame_id)
        self._path_message = messages.PathMessage(self._frame_id)
        self._plan_message = PlanMarkers(settings)

    @property
    def subscribers(self) -> dict[str, int]:
        """Numbers of subscribers to the topics of every decision, for diagnostics."""
        publishers = {
            'command': self._command,
            'decision': self._decisions,
            'path': self._path,
            'wheel': self._wheels,
            **self._seen,
        }
        return {
            f'{name}_subscribers': int(each.get_subscription_count())
            for name, each in publishers.items()
        }

    def command(self, decision: Decision) -> None:
        """Send the command of a decision, stamped as the odometry that it answers."""
        if self._topic is topics.STAMPED_COMMAND:
            self._command.publish(messages.stamped_bytes(decision, self._robot_frame[1]))
        else:
            self._command.publish(messages.twist_bytes(decision))

    def name_robot(self, frame: str) -> None:
        """Name the robot's frame, of commands that are stamped; `base_link` where unknown."""
        if frame != self._robot_frame[0]:
            self._robot_frame = frame, messages.frame_bytes(frame or BASE)

    def report(self, decision: Decision, pose: Sequence[float]) -> None:
        """Send a decision, at a pose ``(3,)`` or none; path and markers only to listeners."""
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
            self._corners.publish(messages.polygon_message(corners, self._frame_id, decision.stamp))

    def show(self, settings: LawSettings, world: World, ahead: Goal | None) -> None:
        """Send road, obstacles and goals, latched; goals before the one ahead are paler."""
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


# Names of nodes that record: ours, and that of `ros2 bag`.
RECORDERS = frozenset({'recorder', 'rosbag2_recorder'})
# Names of nodes that hear commands and obey none; those of the command line begin with `_`.
ONLOOKERS = RECORDERS | {'viewer', 'foxglove_bridge'}
_UNKNOWN = '_NODE_NAME_UNKNOWN_'
# Time in which a recorder that is known here finds the publishers of odometry, too [s].
_SETTLING_TIME = 0.5


class Listeners:
    """Subscribers that a run waits for: the robot, and a recorder for some time [s], 0 for none.

    A robot that listens for another type of command, or has not found this node yet, would
    stand while the time of its task runs; a recorder that comes late has a bag that cannot be
    replayed.
    """

    def __init__(
        self,
        node: LifecycleNode,
        command: Publisher,
        reports: tuple[Publisher, ...],
        recorder_timeout: float,
    ) -> None:
        self._node, self._command, self._reports = node, command, reports
        self._recorder_timeout = recorder_timeout
        self.begin()

    def begin(self) -> None:
        """Another run is to begin."""
        self._since: float | None = None
        self._recorded_since: float | None = None
        self._is_alone = False

    def lacking(self) -> str:
        """Sentence on the listeners a run still waits for; '' if none."""
        return self._robot() or self._recorder()

    def warnings(self) -> list[str]:
        """Warnings about missing listeners while the robot is guided, in sentences."""
        if self._command.get_subscription_count():
            return []
        return [f'Nobody listens to {self._command.topic_name}.']

    def _robot(self) -> str:
        topic, message = self._command.topic_name, self._command.msg_type
        kind = f'{message.__module__.partition(".")[0]}/msg/{message.__name__}'
        found = self._node.get_subscriptions_info_by_topic(topic)
        alike = [each for each in found if each.topic_type == kind]
        names = [each.node_name for each in alike]
        hidden = [each for each in names if each.startswith('_') and each != _UNKNOWN]
        onlookers = sum(each in ONLOOKERS for each in names) + len(hidden)
        if len(alike) > onlookers and self._command.get_subscription_count() > onlookers:
            return ''
        others = [
            f'Another listener wants {each.topic_type}: enable_stamped_cmd_vel.'
            for each in found
            if each.topic_type != kind
        ]
        return ' '.join([f'Waiting for a listener to {topic} ({kind}).', *others[:1]])

    def _recorder(self) -> str:
        now = time.monotonic()
        if not self._recorder_timeout or self._is_alone or self._is_recorded(now):
            return ''
        self._since = now if self._since is None else self._since
        if now - self._since > self._recorder_timeout:
            self._is_alone = True
            self._node.get_logger().warning(
                'no recorder within recorder_timeout: the run begins without'
            )
            return ''
        return 'Waiting for a recorder (recorder_timeout).'

    def _is_recorded(self, now: float) -> bool:
        """True if a recorder has matched all topics of the run, and had time to be discovered."""
        heard = self._node.get_subscriptions_info_by_topic
        publishers = (self._command, *self._reports)
        topics = [each.topic_name for each in publishers]
        topics.append(self._node.resolve_topic_name(GUIDANCE_ODOM.name))
        complete = all(
            any(each.node_name in RECORDERS for each in heard(topic)) for topic in topics
        ) and all(
            each.get_subscription_count() >= len(heard(each.topic_name)) for each in self._reports
        )
        if not complete:
            self._recorded_since = None
            return False
        self._recorded_since = self._recorded_since or now
        return now - self._recorded_since > _SETTLING_TIME
