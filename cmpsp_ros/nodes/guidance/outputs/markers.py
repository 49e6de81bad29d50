"""Road, obstacles and goals, and the latest decision, as markers for RViz and Foxglove."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point
from rclpy.duration import Duration
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from cmpsp_ros.guidance import NANOSECONDS, Decision, Goal, GuidanceSettings, LawSettings, World
from cmpsp_ros.guidance.messages import PeerTrajectory, Track
from cmpsp_ros.guidance.safety import plan_clearance
from cmpsp_ros.nodes.common.messages import set_stamp
from cmpsp_ros.view import LEVEL_COLORS, MOVING, SIGMAS, course, kept_clear
from cmpsp_ros.world.obstacles import outline_of

_HEIGHT = 0.2

_PARTS: Final = {
    'edge': ('road', 0.05),
    'center line': ('centre_line', 0.02),
    'obstacle': ('obstacles', 0.05),
    'kept clear': ('margins', 0.02),
}
"""Namespace and width of lines [m] by kind of part."""

_GOAL = ColorRGBA(r=0.1, g=0.6, b=0.25, a=0.9)
_PASSED = ColorRGBA(r=0.1, g=0.6, b=0.25, a=0.25)
_ARROW = 0.5
_WHITE = ColorRGBA(r=1.0, g=1.0, b=1.0, a=1.0)

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
"""Time ahead for which positions of moving obstacles are shown [s]."""


def marker_array(
    settings: LawSettings, world: World, stamp: Time, ahead: Goal | None = None
) -> MarkerArray:
    """Markers of everything static, replacing all earlier ones.

    Obstacles have a ring around them at the distance that the robot's centre keeps at samples.
    Goals before the one that is driven to, `ahead`, are paler, and their headings are not shown.
    """
    clear = Marker(action=Marker.DELETEALL)
    clear.header.frame_id = settings.frame_id
    markers = [clear]

    def add(namespace: str, marker: Marker) -> None:
        marker.ns = namespace
        marker.id = len(markers)
        marker.header.frame_id = settings.frame_id
        marker.header.stamp = stamp
        marker.pose.orientation.w = 1.0
        markers.append(marker)

    for part in (*course([world.road], world.shapes), kept_clear(settings, world)):
        namespace, width = _PARTS.get(part.kind, ('', 0.0))
        color = _color(part.look.color)
        for center, radius in part.discs:
            add(namespace, _disc(center, radius, color))
        for line in part.outlines if namespace else ():
            add(namespace, _line(line, width, color))
        for name, place in part.names:
            add('obstacle_names', _text(place, name))
    for goal in settings.goals:
        passed = ahead is not None and goal.time < ahead.time
        radius = max(settings.goal_tolerance, 0.1)
        add('goal', _disc(goal.position, radius, _PASSED if passed else _GOAL))
        if goal.heading is not None and not passed:
            add('goal_headings', _arrow(goal.position, goal.heading, _GOAL))
        if goal.name:
            add('goal_names', _text(goal.position, goal.name))
    return MarkerArray(markers=markers)


def _disc(center: tuple[float, float], radius: float, color: ColorRGBA) -> Marker:
    marker = Marker(type=Marker.CYLINDER, color=color)
    marker.pose.position.x, marker.pose.position.y = map(float, center)
    marker.pose.position.z = _HEIGHT / 2.0
    marker.scale.x = marker.scale.y = 2.0 * float(radius)
    marker.scale.z = _HEIGHT
    return marker


def _arrow(tail: tuple[float, float], heading: float, color: ColorRGBA) -> Marker:
    marker = Marker(type=Marker.ARROW, color=color)
    tip = (tail[0] + _ARROW * math.cos(heading), tail[1] + _ARROW * math.sin(heading))
    marker.points = [Point(x=float(x), y=float(y), z=_HEIGHT) for x, y in (tail, tip)]
    marker.scale.x, marker.scale.y = 0.04, 0.1
    return marker


def _line(points: Iterable[Sequence[float]], width: float, color: ColorRGBA) -> Marker:
    marker = Marker(type=Marker.LINE_STRIP, color=color)
    marker.scale.x = width
    marker.points = [Point(x=float(x), y=float(y)) for x, y in points]
    return marker


def _text(center: Sequence[float], text: str) -> Marker:
    marker = Marker(type=Marker.TEXT_VIEW_FACING, text=text, color=_WHITE)
    marker.pose.position.x, marker.pose.position.y = map(float, center)
    marker.pose.position.z = 2.0 * _HEIGHT
    marker.scale.z = 0.3
    return marker


class PlanMarkers:
    """Markers of the latest decision; one message is reused.

    The plan is a band in the colour of its fallback level, and in it a line in the colours of the
    clearance: `NEAR` with only `safety.margin` left, `FAR` with `PLENTY` beyond it. A robot with
    corners has its outline drawn at the start. A withdrawn plan is removed; the reason stays at the
    robot's last position. A moving obstacle has an arrow to its position a second later; the rings
    around it and the arrow's tip are the distance kept by the centre of the robot or its discs. One
    whose place or velocity is in doubt has pale discs there: as large as it may be at two sigma.
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
        """Corners of the robot at the start of the plan."""
        footprint, plan = self._settings.footprint, decision.plan
        if footprint.corners and plan is not None:
            corners = footprint.at(plan.poses[0]).tolist()
            marker = _line((*corners, corners[0]), _RING, self._text.color)
            yield self._placed('footprint', marker)

    def _moving(self, decision: Decision) -> Iterator[Marker]:
        for each in decision.tracks:
            if isinstance(each, PeerTrajectory):
                # It shows itself where it plans to be.
                continue
            age = (decision.stamp - each.stamp) / NANOSECONDS
            x, y = each.x + age * each.vx, each.y + age * each.vy
            tip_x, tip_y = x + _AHEAD * each.vx, y + _AHEAD * each.vy
            disc = Marker(type=Marker.CYLINDER, color=_MOVING)
            disc.pose.position.x, disc.pose.position.y = x, y
            disc.scale.x = disc.scale.y = max(2.0 * each.radius, _WIDTH)
            disc.scale.z = _WIDTH
            arrow = Marker(type=Marker.ARROW, color=_MOVING)
            arrow.points = [Point(x=x, y=y), Point(x=tip_x, y=tip_y)]
            arrow.scale.x, arrow.scale.y = _WIDTH, 2.0 * _WIDTH
            yield self._placed('moving_obstacles', disc, each.id)
            if each.position_stddev or each.velocity_stddev:
                now = _doubt(each, (x, y), age)
                yield self._placed('moving_doubts', now, each.id)
                later = _doubt(each, (tip_x, tip_y), age + _AHEAD)
                yield self._placed('moving_doubts_foreseen', later, each.id)
            yield self._placed('moving_velocities', arrow, each.id)
            yield self._placed('moving_margins', self._ring(each, (x, y), age), each.id)
            later = self._ring(each, (tip_x, tip_y), age + _AHEAD)
            yield self._placed('moving_foreseen', later, each.id)

    def _ring(self, track: Track, center: tuple[float, float], age: float) -> Marker:
        """Distance that the robot's centre keeps from an obstacle seen so long before [s]."""
        settings = self._settings
        moving = settings.moving_obstacles
        doubt = track.position_stddev + age * track.velocity_stddev
        radius = track.radius + moving.growth * age + moving.quantile * doubt
        radius += settings.robot_radius + settings.safety.margin
        return _line(outline_of([center], radius), _RING, _MOVING)

    def _placed(self, namespace: str, marker: Marker, number: int = 0) -> Marker:
        marker.ns, marker.id, marker.header = namespace, number, self._band.header
        marker.pose.orientation.w, marker.lifetime = 1.0, self._band.lifetime
        return marker


def _doubt(track: Track, center: tuple[float, float], age: float) -> Marker:
    """The disc that a track may fill, so long after it was seen [s]."""
    radius = track.radius + SIGMAS * (track.position_stddev + age * track.velocity_stddev)
    marker = _disc(center, radius, _PALE)
    # Below the object itself.
    marker.pose.position.z, marker.scale.z = -_WIDTH / 2.0, _RING
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
    parts = [k / steps for k in range(steps)]
    return [
        ColorRGBA(**{n: (1.0 - f) * getattr(first, n) + f * getattr(last, n) for n in 'rgba'})
        for f in parts
    ]


NEAR, HALFWAY, FAR = _color('#d55e00'), _color('#f0e442'), _color('#009e73')
"""Red, yellow and green that stay apart for colour-blind readers (Okabe and Ito)."""

SCALE: Final = (*_between(NEAR, HALFWAY, 16), *_between(HALFWAY, FAR, 16), FAR)

_MOVING: Final = _color(MOVING)
_PALE: Final = ColorRGBA(r=_MOVING.r, g=_MOVING.g, b=_MOVING.b, a=0.2)
_COLORS: Final = {name: _color(text) for name, text in LEVEL_COLORS.items()}
