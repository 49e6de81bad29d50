"""The plan in the colours of its fallback level and clearance, its reason, moving obstacles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from geometry_msgs.msg import Point
from rclpy.duration import Duration
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from cmpsp_ros.guidance import NANOSECONDS
from cmpsp_ros.guidance.messages import PeerTrajectory
from cmpsp_ros.guidance.safety import plan_clearance
from cmpsp_ros.nodes.guidance.outputs.messages import set_stamp
from cmpsp_ros.view import LEVEL_COLORS
from cmpsp_ros.world.obstacles import outline_of

if TYPE_CHECKING:
    from collections.abc import Iterator

    from cmpsp_ros.guidance import Decision, GuidanceSettings, LawSettings, World
    from cmpsp_ros.guidance.messages import Track

PLENTY: Final = 0.3
"""Clearance beyond `safety.margin` from which on nothing is near [m]."""

_LIFETIME: Final = 5.0
"""Control periods for which markers stay when no more come."""

_WIDTH: Final = 0.06
_BAND: Final = 2.0 * _WIDTH
_RING: Final = 0.02
_TEXT_HEIGHT: Final = 0.25
_ABOVE: Final = 0.6
_AHEAD: Final = 1.0
"""How far ahead what moves is foreseen in the picture [s]."""


class PlanMarkers:
    """Markers of the latest decision; one message is filled again and again.

    The plan is a band in the colour of its fallback level, and in it a line in the colours of the
    clearance: from `NEAR` where only `safety.margin` is left to `FAR` where `PLENTY` is left
    beside. Where it begins is the outline of a robot that has corners. A plan that is gone is
    removed, the reason stays where the robot was last. A moving obstacle is shown where it is, with
    an arrow to where it will be a second later; the rings around it and around the arrow's tip are
    what the robot's centre, or that of its discs, keeps from it.
    """

    def __init__(self, settings: GuidanceSettings) -> None:
        """Make the message for a frame, a course and a control period."""
        self._band = Marker(ns='plan', type=Marker.LINE_STRIP)
        self._band.scale.x = _BAND
        self._line = Marker(ns='clearance', type=Marker.LINE_STRIP, color=SCALE[-1])
        self._line.scale.x = _WIDTH
        # Above the band, for who looks from above.
        self._line.pose.position.z = _RING
        self._text = Marker(ns='level', type=Marker.TEXT_VIEW_FACING, action=Marker.DELETE)
        self._text.scale.z = _TEXT_HEIGHT
        self._text.pose.position.z = _ABOVE
        self._array = MarkerArray(markers=[self._band, self._line, self._text])
        for each in self._array.markers:
            each.header.frame_id = settings.frame_id
            each.pose.orientation.w = 1.0
            each.lifetime = Duration(seconds=_LIFETIME * settings.control_period).to_msg()
        self.take(settings, settings.world)

    def take(self, settings: LawSettings, world: World) -> None:
        """Take another course, in the same frame."""
        self._settings, self._world = settings, world

    def fill(self, decision: Decision) -> MarkerArray:
        """The message of a decision, good until the next."""
        plan = decision.plan
        color = _COLORS['arrived' if decision.finished else decision.level.name.lower()]
        for each in (self._band, self._line, self._text):
            set_stamp(each.header, decision.stamp)
        self._band.color = self._text.color = color
        self._text.text = f'{decision.level.name.lower()}: {decision.reason}'
        points, colors = [], []
        if plan is not None:
            places = plan.poses[:, :2].tolist()
            points = [Point(x=x, y=y) for x, y in places]
            spare = (
                plan_clearance(self._settings, self._world, decision) - self._settings.safety.margin
            )
            colors = [color_of(each) for each in spare.tolist()]
            self._text.pose.position.x, self._text.pose.position.y = places[0]
            self._text.action = Marker.ADD
        for each in (self._band, self._line):
            each.action = Marker.DELETE if plan is None else Marker.ADD
            each.points = points
        self._line.colors = colors
        outline = self._outline(decision)
        self._array.markers = [self._band, self._line, self._text, *outline]
        self._array.markers += self._moving(decision)
        return self._array

    def _outline(self, decision: Decision) -> Iterator[Marker]:
        """The corners of the robot where the plan begins."""
        footprint, plan = self._settings.footprint, decision.plan
        if footprint.corners and plan is not None:
            corners = footprint.at(plan.poses[0]).tolist()
            marker = Marker(ns='footprint', type=Marker.LINE_STRIP, color=self._text.color)
            marker.header, marker.lifetime = self._band.header, self._band.lifetime
            marker.pose.orientation.w = 1.0
            marker.scale.x = _RING
            marker.points = [Point(x=x, y=y) for x, y in (*corners, corners[0])]
            yield marker

    def _moving(self, decision: Decision) -> Iterator[Marker]:
        for each in decision.tracks:
            if isinstance(each, PeerTrajectory):
                # It shows itself where it plans to be.
                continue
            age = (decision.stamp - each.stamp) / NANOSECONDS
            x, y = each.x + age * each.vx, each.y + age * each.vy
            tip_x, tip_y = x + _AHEAD * each.vx, y + _AHEAD * each.vy
            disc = Marker(ns='moving_obstacles', type=Marker.CYLINDER)
            disc.pose.position.x, disc.pose.position.y = x, y
            disc.scale.x = disc.scale.y = max(2.0 * each.radius, _WIDTH)
            disc.scale.z = _WIDTH
            arrow = Marker(ns='moving_velocities', type=Marker.ARROW)
            arrow.points = [Point(x=x, y=y), Point(x=tip_x, y=tip_y)]
            arrow.scale.x, arrow.scale.y = _WIDTH, 2.0 * _WIDTH
            now = self._ring('moving_margins', each, (x, y), age)
            later = self._ring('moving_foreseen', each, (tip_x, tip_y), age + _AHEAD)
            for marker in (disc, arrow, now, later):
                marker.id, marker.color = each.id, _MOVING
                marker.header = self._band.header
                marker.pose.orientation.w = 1.0
                marker.lifetime = self._band.lifetime
                yield marker

    def _ring(
        self, namespace: str, track: Track, center: tuple[float, float], age: float
    ) -> Marker:
        """What the robot's centre keeps from something that was seen so long [s] before."""
        settings = self._settings
        radius = track.radius + settings.moving_obstacles.growth * age
        radius += settings.robot_radius + settings.safety.margin
        marker = Marker(ns=namespace, type=Marker.LINE_STRIP)
        marker.scale.x = _RING
        marker.points = [Point(x=float(x), y=float(y)) for x, y in outline_of([center], radius)]
        return marker


def color_of(spare: float) -> ColorRGBA:
    """Colour of a stage that is so much clearer than it must be [m]."""
    return SCALE[round((len(SCALE) - 1) * min(max(spare / PLENTY, 0.0), 1.0))]


def _color(text: str) -> ColorRGBA:
    """A colour written as `#rrggbb`."""
    red, green, blue = (part / 255.0 for part in bytes.fromhex(text.removeprefix('#')))
    return ColorRGBA(r=red, g=green, b=blue, a=1.0)


def _between(first: ColorRGBA, last: ColorRGBA, steps: int) -> list[ColorRGBA]:
    """Colours from one towards another, which is left out."""
    return [
        ColorRGBA(**{
            name: (1.0 - k / steps) * getattr(first, name) + k / steps * getattr(last, name)
            for name in 'rgba'
        })
        for k in range(steps)
    ]  # fmt: skip


NEAR, HALFWAY, FAR = _color('#d55e00'), _color('#f0e442'), _color('#009e73')
"""Red, yellow and green that stay apart for colour-blind readers (Okabe and Ito)."""

SCALE: Final = (*_between(NEAR, HALFWAY, 16), *_between(HALFWAY, FAR, 16), FAR)

_MOVING: Final = _color('#b03a8c')
_COLORS: Final = {name: _color(text) for name, text in LEVEL_COLORS.items()}
