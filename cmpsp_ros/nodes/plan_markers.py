"""The plan in the colour of its rung, and the rung with its sentence beside the robot."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from geometry_msgs.msg import Point
from rclpy.duration import Duration
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from cmpsp_ros.bags.report.palette import RUNGS
from cmpsp_ros.guidance.horizon import NANOSECONDS
from cmpsp_ros.guidance.other_plans import OtherPlan
from cmpsp_ros.nodes.guidance_messages import set_stamp

if TYPE_CHECKING:
    from collections.abc import Iterator

    from cmpsp_ros.guidance.decision import Decision

_LIFETIME: Final = 5.0
"""Control periods for which markers stay when no more come."""

_WIDTH: Final = 0.06
_TEXT_HEIGHT: Final = 0.25
_ABOVE: Final = 0.6


class PlanMarkers:
    """Markers of the latest decision; one message is filled again and again.

    A plan that is there no more is taken away, the sentence stays where the robot was last. What
    moves is shown where it is, with an arrow to where it will be a second later.
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
        for each in (self._plan, self._rung):
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
        self._array.markers = [self._plan, self._rung, *self._moving(decision)]
        return self._array

    def _moving(self, decision: Decision) -> Iterator[Marker]:
        for each in decision.tracks:
            if isinstance(each, OtherPlan):
                # It shows itself where it plans to be.
                continue
            age = (decision.stamp - each.stamp) / NANOSECONDS
            x, y = each.x + age * each.vx, each.y + age * each.vy
            disc = Marker(ns='moving_obstacles', id=each.id, type=Marker.CYLINDER, color=_MOVING)
            disc.pose.position.x, disc.pose.position.y = x, y
            disc.scale.x = disc.scale.y = max(2.0 * each.radius, _WIDTH)
            disc.scale.z = _WIDTH
            arrow = Marker(ns='moving_velocities', id=each.id, type=Marker.ARROW, color=_MOVING)
            arrow.points = [Point(x=x, y=y), Point(x=x + each.vx, y=y + each.vy)]
            arrow.scale.x, arrow.scale.y = _WIDTH, 2.0 * _WIDTH
            for marker in (disc, arrow):
                marker.header = self._plan.header
                marker.pose.orientation.w = 1.0
                marker.lifetime = self._plan.lifetime
                yield marker


def _color(text: str) -> ColorRGBA:
    """A colour written as `#rrggbb`."""
    red, green, blue = (part / 255.0 for part in bytes.fromhex(text.removeprefix('#')))
    return ColorRGBA(r=red, g=green, b=blue, a=1.0)


_MOVING: Final = _color('#b03a8c')
_COLORS: Final = {name: _color(text) for name, text in RUNGS.items()}
