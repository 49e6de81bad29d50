"""The plan in the colour of its rung, and the rung with its sentence beside the robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from geometry_msgs.msg import Point
from rclpy.duration import Duration
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from cmpsp_ros.bags.report.palette import RUNGS
from cmpsp_ros.nodes.guidance_messages import set_stamp

if TYPE_CHECKING:
    from cmpsp_ros.guidance.decision import Decision

_LIFETIME: Final = 5.0
"""Control periods for which markers stay when no more come."""

_WIDTH: Final = 0.06
_TEXT_HEIGHT: Final = 0.25
_ABOVE: Final = 0.6


class PlanMarkers:
    """Markers of the latest decision; one message is filled again and again.

    A plan that is there no more is taken away, the sentence stays where the robot was last.
    """

    def __init__(self, frame_id: str, control_period: float) -> None:
        """Make the message, in a frame, for decisions that come every so often [s]."""
        self._plan = Marker(ns='plan', type=Marker.LINE_STRIP)
        self._plan.scale.x = _WIDTH
        self._rung = Marker(ns='rung', type=Marker.TEXT_VIEW_FACING, action=Marker.DELETE)
        self._rung.scale.z = _TEXT_HEIGHT
        self._rung.pose.position.z = _ABOVE
        self._array = MarkerArray(markers=[self._plan, self._rung])
        for each in self._array.markers:
            each.header.frame_id = frame_id
            each.pose.orientation.w = 1.0
            each.lifetime = Duration(seconds=_LIFETIME * control_period).to_msg()

    def fill(self, decision: Decision) -> MarkerArray:
        """The message of a decision, good until the next."""
        color = _COLORS['arrived' if decision.finished else decision.rung.name.lower()]
        for each in self._array.markers:
            set_stamp(each.header, decision.stamp)
            each.color = color
        self._rung.text = f'{decision.rung.name.lower()}: {decision.reason}'
        self._plan.action = Marker.DELETE if decision.plan is None else Marker.ADD
        self._plan.points = []
        if decision.plan is not None:
            places = decision.plan.poses[:, :2].tolist()
            self._plan.points = [Point(x=x, y=y) for x, y in places]
            self._rung.pose.position.x, self._rung.pose.position.y = places[0]
            self._rung.action = Marker.ADD
        return self._array


def _color(text: str) -> ColorRGBA:
    """A colour written as `#rrggbb`."""
    red, green, blue = (part / 255.0 for part in bytes.fromhex(text.removeprefix('#')))
    return ColorRGBA(r=red, g=green, b=blue, a=1.0)


_COLORS: Final = {name: _color(text) for name, text in RUNGS.items()}
