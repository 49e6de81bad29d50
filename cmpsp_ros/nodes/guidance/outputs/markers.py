"""Road, obstacles and goal as markers for RViz and Foxglove."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from geometry_msgs.msg import Point
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from cmpsp_ros.guidance.formulation import sample_space
from cmpsp_ros.world.obstacles import outlines

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from builtin_interfaces.msg import Time

    from cmpsp_ros.guidance import Goal, LawSettings, World

_HEIGHT = 0.2

_ROAD = (0.45, 0.45, 0.45, 1.0)
_OBSTACLE = (0.85, 0.25, 0.2, 0.9)
_MARGIN = (0.95, 0.6, 0.1, 0.9)
_GOAL = (0.1, 0.6, 0.25, 0.9)
_PASSED = (0.1, 0.6, 0.25, 0.25)
_ARROW = 0.5


def marker_array(
    settings: LawSettings, world: World, stamp: Time, ahead: Goal | None = None
) -> MarkerArray:
    """Markers of everything that does not move, replacing all that were there.

    Obstacles have a ring around them at the distance that the robot's centre keeps at samples.

    Args:
        settings: With the goals.
        world: Road and static obstacles.
        stamp: Of all of them.
        ahead: The goal that is driven to; those that come before it are paler, and their headings
            are not shown.
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

    road = world.road
    for edge in road.edges():
        add('road', _line(edge, 0.05, _ROAD))
    if len(road.center_line()):
        add('centre_line', _line(road.center_line(), 0.02, _ROAD))
    kept = sample_space(settings, world)
    for obstacle, center, radius in zip(
        world.shapes, kept.centers.tolist(), kept.radii.tolist(), strict=True
    ):
        if len(obstacle.corners) == 1:
            add('obstacles', _disc(obstacle.center, obstacle.radius, _OBSTACLE))
        else:
            for line in outlines(obstacle, obstacle.radius):
                add('obstacles', _line(line, 0.05, _OBSTACLE))
        if obstacle.corners:
            add('obstacle_names', _text(center, obstacle.name))
        for line in outlines(obstacle, radius):
            add('margins', _line(line, 0.02, _MARGIN))
    for goal in settings.goals:
        passed = ahead is not None and goal.time < ahead.time
        radius = max(settings.goal_tolerance, 0.1)
        add('goal', _disc(goal.position, radius, _PASSED if passed else _GOAL))
        if goal.heading is not None and not passed:
            add('goal_headings', _arrow(goal.position, goal.heading, _GOAL))
        if goal.name:
            add('goal_names', _text(goal.position, goal.name))
    return MarkerArray(markers=markers)


def _disc(center: tuple[float, float], radius: float, color: tuple[float, ...]) -> Marker:
    marker = Marker(type=Marker.CYLINDER, color=_color(color))
    marker.pose.position.x, marker.pose.position.y = map(float, center)
    marker.pose.position.z = _HEIGHT / 2.0
    marker.scale.x = marker.scale.y = 2.0 * float(radius)
    marker.scale.z = _HEIGHT
    return marker


def _arrow(tail: tuple[float, float], heading: float, color: tuple[float, ...]) -> Marker:
    marker = Marker(type=Marker.ARROW, color=_color(color))
    tip = (tail[0] + _ARROW * math.cos(heading), tail[1] + _ARROW * math.sin(heading))
    marker.points = [Point(x=float(x), y=float(y), z=_HEIGHT) for x, y in (tail, tip)]
    marker.scale.x, marker.scale.y = 0.04, 0.1
    return marker


def _line(points: Iterable[Sequence[float]], width: float, color: tuple[float, ...]) -> Marker:
    marker = Marker(type=Marker.LINE_STRIP, color=_color(color))
    marker.scale.x = width
    marker.points = [Point(x=float(x), y=float(y)) for x, y in points]
    return marker


def _text(center: Sequence[float], text: str) -> Marker:
    marker = Marker(type=Marker.TEXT_VIEW_FACING, text=text, color=_color((1.0, 1.0, 1.0, 1.0)))
    marker.pose.position.x, marker.pose.position.y = map(float, center)
    marker.pose.position.z = 2.0 * _HEIGHT
    marker.scale.z = 0.3
    return marker


def _color(rgba: tuple[float, ...]) -> ColorRGBA:
    return ColorRGBA(**dict(zip('rgba', rgba, strict=True)))
