"""Messages in other frames, transformed to the frame of the course by `/tf`."""

import math
from collections import deque
from dataclasses import replace
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry, Path
from rclpy.lifecycle import LifecycleNode
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import Goal, GoalError, GuidanceSettings, messages
from cmpsp_ros.nodes.common.messages import cloud_of, road_in, set_pose
from cmpsp_ros.nodes.common.topic import Listener, Topic
from cmpsp_ros.nodes.common.topics import OWN_GOAL_POSE, OWN_MOVING, OWN_ODOM
from cmpsp_ros.parameters import ParameterError, Problem
from cmpsp_ros.sensing import stamp_of

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # tf2 is not among the wheels
    TFMessage = None

_DEPTH = 500


class TransformInput(Listener):
    """Receives transforms, which are read only on request.

    Messages transformed to the frame of the course are published there, so that a bag holds the
    inputs of decisions and needs no transforms. Without a robot's frame its centre is that of
    odometry.
    """

    def __init__(self, node: LifecycleNode, robot_frame: str, settings: GuidanceSettings) -> None:
        super().__init__(node)
        self.settings, self._robot_frame = settings, robot_frame
        self._transforms = messages.Transforms()
        self._unread: deque[bytes] = deque(maxlen=_DEPTH)
        self._odometry = self._publish_on(OWN_ODOM)
        self._goals = self._publish_on(OWN_GOAL_POSE)
        self._moving = self._publish_on(OWN_MOVING)
        topics = ('/tf', False, self._keep), ('/tf_static', True, self._hear_static)
        for name, latched, hear in topics if TFMessage is not None else ():
            topic = Topic('guidance', 'in', name, TFMessage, '', depth=_DEPTH, latched=latched)
            self._subscriptions.append(topic.listen_on(node, hear, raw=True))

    def forget_after(self, stamp: int) -> None:
        """Forget transforms of another run: time has jumped back to an instant [ns]."""
        self._transforms.forget_after(stamp)

    def robot_frame(self, child_frame: str) -> str:
        """Frame of the robot's centre, where odometry is of a child frame."""
        return self._robot_frame or child_frame

    def pose_of(self, reading: messages.OdometryReading, data: bytes) -> tuple[Array, bool]:
        """Pose of the robot's centre by odometry, and True if transformed; raises OdometryError."""
        stamp, frame, child = reading[:3]
        center = self.robot_frame(child)
        if frame == self.settings.frame_id and center == child:
            return reading.pose_in(frame), False
        there = self._in_frame('Odometry is', frame, stamp, messages.OdometryError)
        try:
            upon = self._look_up(child, center, stamp)
        except messages.TransformError as error:
            why = f'Odometry is of {child!r}, wanted {center!r} (robot_frame): {error}.'
            raise messages.OdometryError(why) from error
        pose = messages.compose(messages.compose(there, reading.pose_in(frame)), upon)
        if self._odometry.get_subscription_count():
            self._publish_odometry(data, center, pose, upon)
        return pose, True

    def goal_of(self, message: PoseStamped) -> tuple[int, Goal]:
        """Stamp [ns] and goal of a message, in the frame of the course, published; GoalError."""
        wanted, frame = self.settings.frame_id, message.header.frame_id
        if frame != wanted:
            stamp, goal = messages.goal_of(message, frame)
            there = self._in_frame('The goal is', frame, stamp, GoalError)
            message = PoseStamped(header=Header(stamp=message.header.stamp, frame_id=wanted))
            set_pose(
                message.pose,
                messages.compose(there, np.array([*goal.position, goal.heading or 0.0])),
            )
            if goal.heading is None:
                message.pose.orientation.z = message.pose.orientation.w = 0.0
        received = messages.goal_of(message, wanted)
        self._goals.publish(message)
        return received

    def tracks_of(self, message: PointCloud2) -> list[messages.Track]:
        """Moving obstacles in a message; velocities are over ground, along its axes; TrackError."""
        wanted, frame = self.settings.frame_id, message.header.frame_id
        tracks, stamp = messages.told_tracks_of(message, frame), stamp_of(message)
        if frame == wanted:
            return tracks
        there = self._in_frame('Obstacles are', frame, stamp, messages.TrackError)
        moved = []
        for each in tracks:
            x, y, _ = messages.compose(there, np.array([each.x, each.y, 0.0])).tolist()
            vx, vy = _turned(each.vx, each.vy, float(there[2]))
            moved.append(replace(each, x=x, y=y, vx=vx, vy=vy))
        self._moving.publish(cloud_of(moved, stamp, wanted))
        return moved

    def frame_at(self, frame: str, stamp: int, *, with_motion: bool) -> tuple[Array, Array]:
        """Pose and velocity ``(3,)`` of a tracker's frame in that of the course; TrackError."""
        there = self._in_frame('Objects are', frame, stamp, messages.TrackError)
        wanted, timeout = self.settings.frame_id, self.settings.odom_timeout
        if not with_motion or frame == wanted:
            return there, np.zeros(3)
        try:
            return self._transforms.motion(wanted, frame, stamp, timeout)
        except messages.TransformError as why:
            raise messages.TrackError(f'Objects are in frame {frame!r}: {why}.') from why

    def road_in(self, message: Path) -> dict[str, Any]:
        """Parameters of a road, placed by the latest transform, or ParameterError."""
        wanted, frame = self.settings.frame_id, message.header.frame_id
        changes = road_in(message, frame)
        if frame == wanted:
            return changes
        try:
            there = self.frame_pose(frame)
        except messages.TransformError as error:
            problem = Problem('road', f'frame {frame!r}', f'{wanted!r} (frame_id): {error}')
            raise ParameterError(problem) from error
        numbers = changes['road.points']
        points = zip(numbers[::2], numbers[1::2], strict=True)
        moved = [messages.compose(there, np.array([*each, 0.0]))[:2].tolist() for each in points]
        return {**changes, 'road.points': [number for each in moved for number in each]}

    def frame_pose(self, frame: str) -> Array:
        """Pose of a frame in that of the course by the latest transform, ``(3,)``."""
        return self._look_up(self.settings.frame_id, frame, 0)

    def _publish_odometry(self, data: bytes, center: str, pose: Array, upon: Array) -> None:
        message = deserialize_message(data, Odometry)
        message.header.frame_id, message.child_frame_id = self.settings.frame_id, center
        set_pose(message.pose.pose, pose)
        twist = message.twist.twist
        x = twist.linear.x - twist.angular.z * float(upon[1])
        y = twist.linear.y + twist.angular.z * float(upon[0])
        twist.linear.x, twist.linear.y = _turned(x, y, -float(upon[2]))
        self._odometry.publish(message)

    def _in_frame(self, what: str, frame: str, stamp: int, error: type[ValueError]) -> Array:
        """Pose of a message's frame in the course's, shape ``(3,)`` [m, m, rad]."""
        wanted = self.settings.frame_id
        try:
            return self._look_up(wanted, frame, stamp)
        except messages.TransformError as why:
            raise error(f'{what} in frame {frame!r}, wanted {wanted!r} (frame_id): {why}.') from why

    def _look_up(self, target: str, source: str, stamp: int) -> Array:
        """Pose of a frame in another one at a time [ns]; raises TransformError."""
        if target == source:
            return np.zeros(3)
        if TFMessage is None:
            raise messages.TransformError('tf2_msgs, for a transform, is not installed')
        self.drain()
        while self._unread:
            self._transforms.add(deserialize_message(self._unread.popleft(), TFMessage))
        return self._transforms.look_up(target, source, stamp, self.settings.odom_timeout)

    # rclpy asks a callback for its signature, which the queue's own method has none of.
    def _keep(self, data: bytes) -> None:
        self._unread.append(data)

    def _hear_static(self, data: bytes) -> None:
        self._transforms.add(deserialize_message(data, TFMessage), is_static=True)


def _turned(x: float, y: float, angle: float) -> tuple[float, float]:
    cosine, sine = math.cos(angle), math.sin(angle)
    return cosine * x - sine * y, sine * x + cosine * y
