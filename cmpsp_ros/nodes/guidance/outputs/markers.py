"""Road, obstacles and goals, and the latest decision, as markers for RViz and Foxglove."""

import math
from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point
from rclpy.duration import Duration
from std_msgs.msg import ColorRGBA, Header
from visualization_msgs.msg import Marker, MarkerArray

from cmpsp_ros.guidance import NANOSECONDS, Decision, Goal, GuidanceSettings, LawSettings, World
from cmpsp_ros.guidance.messages import PeerTrajectory, Track
from cmpsp_ros.guidance.safety import plan_clearance
from cmpsp_ros.view import LEVEL_COLORS, MOVING, SIGMAS, course, kept_clear

_HEIGHT = 0.2

# Namespace and width of lines [m] by kind of part.
_PARTS: Final = {
    'edge': ('road', 0.05),
    'center line': ('centre_line', 0.02),
    'obstacle': ('obstacles', 0.05),
    'kept clear': ('margins', 0.02),
}

_GOAL = ColorRGBA(r=0.1, g=0.6, b=0.25, a=0.9)
_PASSED = ColorRGBA(r=0.1, g=0.6, b=0.25, a=0.25)
_ARROW = 0.5
_WHITE = ColorRGBA(r=1.0, g=1.0, b=1.0, a=1.0)

PLENTY: Final = 0.3  # clearance beyond `safety.margin` from which on nothing is near [m]
_LIFETIME: Final = 5.0  # control periods for which markers stay when no more come
_WIDTH: Final = 0.06
_RING: Final = 0.02
# Parts of a metre and shades of a colour that are drawn: bags of numbers with few bits are small.
_FINE, _SHADES = 1024.0, 32
_AHEAD: Final = 1.0  # time ahead for which positions of moving obstacles are shown [s]


class _Markers:
    """Markers of one frame and time, with a lifetime [s], 0 for ever."""

    def __init__(self, frame_id: str, stamp: Time, lifetime: float = 0.0) -> None:
        self._header = Header(frame_id=frame_id, stamp=stamp)
        self._lifetime = Duration(seconds=lifetime).to_msg()
        self.all: list[Marker] = []

    def add(self, namespace: str, marker: Marker, number: int | None = None) -> None:
        """Add a marker of a number, by default the next one."""
        marker.header, marker.lifetime, marker.ns = self._header, self._lifetime, namespace
        marker.id = len(self.all) if number is None else number
        marker.pose.orientation.w = 1.0
        self.all.append(marker)


def marker_array(
    settings: LawSettings, world: World, stamp: Time, ahead: Goal | None = None
) -> MarkerArray:
    """Markers of everything static, replacing all earlier ones; goals before `ahead` are paler.

    Obstacles have a ring around them at the distance that the robot's centre keeps at samples.
    """
    made = _Markers(settings.frame_id, stamp)
    made.add('', Marker(action=Marker.DELETEALL))
    for part in (*course([world.road], world.shapes), kept_clear(settings, world)):
        namespace, width = _PARTS.get(part.kind, ('', 0.0))
        color = _color(part.look.color)
        for center, radius in part.discs:
            made.add(namespace, _disc(center, radius, color))
        for line in part.outlines if namespace else ():
            made.add(namespace, _line(line, width, color))
        for name, place in part.names:
            made.add('obstacle_names', _text(place, name))
    for goal in settings.goals:
        passed = ahead is not None and goal.time < ahead.time
        radius = max(settings.goal_tolerance, 0.1)
        made.add('goal', _disc(goal.position, radius, _PASSED if passed else _GOAL))
        if goal.heading is not None and not passed:
            x, y = goal.position
            tip = x + _ARROW * math.cos(goal.heading), y + _ARROW * math.sin(goal.heading)
            made.add('goal_headings', _arrow((goal.position, tip), 0.05, _GOAL, _HEIGHT))
        if goal.name:
            made.add('goal_names', _text(goal.position, goal.name))
    return MarkerArray(markers=made.all)


def _disc(
    center: Sequence[float],
    radius: float,
    color: ColorRGBA,
    height: float = _HEIGHT,
    z: float = _HEIGHT / 2.0,
) -> Marker:
    marker = Marker(type=Marker.CYLINDER, color=color)
    marker.pose.position = _point(center, z)
    marker.scale.x = marker.scale.y = 2.0 * float(radius)
    marker.scale.z = height
    return marker


def _arrow(ends: Iterable[Sequence[float]], width: float, color: ColorRGBA, z: float) -> Marker:
    marker = Marker(type=Marker.ARROW, color=color)
    marker.points = [_point(each, z) for each in ends]
    marker.scale.x, marker.scale.y = width, 2.0 * width
    return marker


def _line(points: Iterable[Sequence[float]], width: float, color: ColorRGBA) -> Marker:
    marker = Marker(type=Marker.LINE_STRIP, color=color)
    marker.scale.x = width
    marker.points = [_point(each) for each in points]
    return marker


def _text(
    center: Sequence[float], text: str, color: ColorRGBA = _WHITE, size: float = 0.3, z: float = 0.4
) -> Marker:
    marker = Marker(type=Marker.TEXT_VIEW_FACING, text=text, color=color)
    marker.pose.position = _point(center, z)
    marker.scale.z = size
    return marker


def _point(place: Sequence[float], z: float = 0.0) -> Point:
    return Point(x=float(place[0]), y=float(place[1]), z=z)


class PlanMarkers:
    """Markers of the latest decision: the plan in the colour of its level, and moving obstacles.

    A line in the plan has the colours of its clearance: `NEAR` with only `safety.margin` left,
    `FAR` with `PLENTY` beyond it. Arrows lead to positions a second later; rings are the
    distances kept, pale discs the doubt at two sigma.
    """

    def __init__(self, settings: GuidanceSettings) -> None:
        self._frame_id, self._place = settings.frame_id, list[float]()
        self._lifetime = _LIFETIME * settings.control_period
        self.take(settings, settings.world)

    def take(self, settings: LawSettings, world: World) -> None:
        """Take another course, in the same frame."""
        self._settings, self._world = settings, world

    def fill(self, decision: Decision) -> MarkerArray:
        """The message of a decision."""
        plan, level = decision.plan, decision.level.name.lower()
        sec, nanosec = divmod(decision.stamp, NANOSECONDS)
        made = _Markers(self._frame_id, Time(sec=sec, nanosec=nanosec), self._lifetime)
        color = _COLORS['arrived' if decision.finished else level]
        places = [] if plan is None else _coarse(plan.poses[:, :2]).tolist()
        self._place = places[0] if places else self._place
        band, line = _line(places, 2.0 * _WIDTH, color), _line(places, _WIDTH, FAR)
        # Above the band, for who looks from above.
        line.pose.position.z = _RING
        if plan is not None:
            near = plan_clearance(self._settings, self._world, decision)
            line.colors = [color_of(each - self._settings.safety.margin) for each in near.tolist()]
        text = _text(self._place or (0.0, 0.0), f'{level}: {decision.reason}', color, 0.25, 0.6)
        for name, marker, is_there in (
            ('plan', band, places),
            ('clearance', line, places),
            ('level', text, self._place),
        ):
            marker.action = Marker.ADD if is_there else Marker.DELETE
            made.add(name, marker, 0)
        if self._settings.footprint.corners and plan is not None:
            corners = self._settings.footprint.at(plan.poses[0]).tolist()
            made.add('footprint', _line((*corners, corners[0]), _RING, color), 0)
        for each in decision.tracks:
            # Another robot shows itself where it plans to be.
            if not isinstance(each, PeerTrajectory):
                self._add_track(made, each, (decision.stamp - each.stamp) / NANOSECONDS)
        return MarkerArray(markers=made.all)

    def _add_track(self, made: _Markers, track: Track, age: float) -> None:
        """Add a moving obstacle that was seen so long before [s]."""
        here, tip = (
            _coarse(np.array([track.x + since * track.vx, track.y + since * track.vy]))
            for since in (age, age + _AHEAD)
        )
        disc = _disc(here, _coarse(max(track.radius, _WIDTH / 2.0)), _MOVING, _WIDTH, 0.0)
        made.add('moving_obstacles', disc, track.id)
        made.add('moving_velocities', _arrow((here, tip), _WIDTH, _MOVING, 0.0), track.id)
        moving, kept = self._settings.moving_obstacles, self._settings.robot_radius
        kept += self._settings.safety.margin
        for suffix, margin, center, since in (
            ('', 'moving_margins', here, age),
            ('_foreseen', 'moving_foreseen', tip, age + _AHEAD),
        ):
            doubt = track.position_stddev + since * track.velocity_stddev
            if track.position_stddev or track.velocity_stddev:
                # Below the object itself.
                radius = _coarse(track.radius + SIGMAS * doubt)
                pale = _disc(center, radius, _PALE, _RING, -_WIDTH / 2.0)
                made.add(f'moving_doubts{suffix}', pale, track.id)
            radius = track.radius + moving.growth * since + moving.quantile * doubt + kept
            kept_clear_of = _disc(center, _coarse(radius), _PALER, _RING, -_WIDTH)
            made.add(margin, kept_clear_of, track.id)


def _coarse(lengths: Any) -> Any:
    return np.round(lengths * _FINE) / _FINE


def color_of(spare: float) -> ColorRGBA:
    """Colour of a stage that is so much clearer than it must be [m]."""
    at = round(min(max(spare / PLENTY, 0.0), 1.0) * _SHADES) / _SHADES
    scale = np.array([[each.r, each.g, each.b] for each in (NEAR, HALFWAY, FAR)]).T
    red, green, blue = (float(np.interp(at, (0.0, 0.5, 1.0), each)) for each in scale)
    return ColorRGBA(r=red, g=green, b=blue, a=1.0)


def _color(text: str) -> ColorRGBA:
    """A colour written as `#rrggbb`."""
    red, green, blue = (part / 255.0 for part in bytes.fromhex(text.removeprefix('#')))
    return ColorRGBA(r=red, g=green, b=blue, a=1.0)


# Red, yellow and green that stay apart for colour-blind readers (Okabe and Ito).
NEAR, HALFWAY, FAR = _color('#d55e00'), _color('#f0e442'), _color('#009e73')

_MOVING: Final = _color(MOVING)
_PALE: Final = ColorRGBA(r=_MOVING.r, g=_MOVING.g, b=_MOVING.b, a=0.2)
_PALER: Final = ColorRGBA(r=_MOVING.r, g=_MOVING.g, b=_MOVING.b, a=0.1)
_COLORS: Final = {name: _color(text) for name, text in LEVEL_COLORS.items()}
