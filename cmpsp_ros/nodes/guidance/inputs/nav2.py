"""Nav2's action messages, whose fields depend on the distribution of ROS."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from geometry_msgs.msg import PoseStamped


def follow_path_feedback(kind: Any, pose: PoseStamped, distance: float, speed: float) -> Any:
    """Feedback of FollowPath: distance [m] to the goal along the path, and speed [m/s].

    From Lyrical on they are fields of a message `nav2_msgs/TrackingFeedback`, beside the pose. Its
    tracking errors stay 0: the path is a road here, on which the robot may drive anywhere.
    """
    feedback = kind.Feedback()
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
