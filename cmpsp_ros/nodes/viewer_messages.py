"""Messages prepared for the page: plain numbers and text, of bounded size.

Anybody may publish on these topics: no message can make the page large or slow.
"""

from __future__ import annotations

import math
from typing import Any, Final

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from sensor_msgs.msg import JointState
from visualization_msgs.msg import Marker, MarkerArray

from cmpsp_ros.guidance import DECISION_KEYS, Key
from cmpsp_ros.sensing import grid_of
from cmpsp_ros.view import grid_picture
from cmpsp_ros.world.grids import GridError

SERIES: Final = ('path', 'steps')
"""Series kept row by row: (x, y); and `step_of` each decision."""
_SHOWN: Final = {**DECISION_KEYS, 'step_ms': Key(float)}
_MOST_MARKERS: Final = 500
_MOST_POINTS: Final = 2000
_MOST_WHEELS: Final = 8
_LONGEST_TEXT: Final = 500
_KINDS: Final = {
    Marker.LINE_STRIP: 'line',
    Marker.CYLINDER: 'disc',
    Marker.TEXT_VIEW_FACING: 'text',
}


def place_of(message: Odometry) -> tuple[float, float, float] | None:
    """Pose (x, y, heading) [m, m, rad]; None if not finite."""
    position, q = message.pose.pose.position, message.pose.pose.orientation
    heading = math.atan2(2.0 * (q.w * q.z + q.x * q.y), q.w**2 + q.x**2 - q.y**2 - q.z**2)
    place = (position.x, position.y, heading)
    return place if all(map(math.isfinite, place)) else None


def decision_of(message: DiagnosticArray) -> dict[str, Any]:
    """A decision by key; missing or meaningless values are None.

    The level of one after the final time is `arrived`, unless the goal was missed.
    """
    # Of anybody's making: an array of none is a decision that lacks everything.
    status = next(iter(message.status), DiagnosticStatus())
    texts = {each.key: _short(each.value) for each in status.values}
    shown = {key: _value(each, texts.get(key)) for key, each in _SHOWN.items()}
    shown['reason'] = _short(status.message)
    two = shown['wheel_speed_right'], shown['wheel_speed_left']
    shown['wheels'] = list(shown['wheel_speeds'] or two)[:_MOST_WHEELS]
    missed = shown['missed'] or shown['halted']
    shown['level'] = 'arrived' if shown['finished'] and not missed else shown['fallback_level']
    return shown


def _value(key: Key, text: str | None) -> Any:
    try:
        return None if text is None else key.parse(text)
    except ValueError:
        return None


def step_of(decision: dict[str, Any]) -> list[Any]:
    """Time left, wheel speeds and the steering angle of a car, clearance and level."""
    angle = decision['steering_angle']
    controls = [*decision['wheels'], *(() if angle is None else (angle,))]
    return [decision['time_left'], *controls, decision['clearance'], decision['level']]


def plan_of(message: Path) -> list[list[float]]:
    """Points (x, y) [m] of a plan."""
    places = (each.pose.position for each in message.poses[:_MOST_POINTS])
    return [[each.x, each.y] for each in places]


def seen_of(message: OccupancyGrid) -> dict[str, Any]:
    """The picture of a grid, or GridError where it is none, or turned."""
    grid = grid_of(message, message.header.frame_id)
    if grid.origin[2] != 0.0:
        raise GridError('origin', f'{grid.origin[2]} rad', 'a grid along the axes')
    return grid_picture(grid)


def speeds_of(message: JointState) -> list[float]:
    """Speeds of all wheels [rad/s]."""
    return list(message.velocity[:_MOST_WHEELS])


def course_of(message: MarkerArray) -> list[dict[str, Any]]:
    """Lines, discs and texts to draw, in their order, each in its colour."""
    kinds = ((_KINDS.get(each.type), each) for each in message.markers[:_MOST_MARKERS])
    return [
        {
            'kind': kind,
            'of': _short(each.ns),
            'at': [each.pose.position.x, each.pose.position.y],
            'size': each.scale.x,
            'color': [each.color.r, each.color.g, each.color.b, each.color.a],
            'points': [[point.x, point.y] for point in each.points[:_MOST_POINTS]],
            'text': _short(each.text),
        }
        for kind, each in kinds
        if kind is not None and each.action == Marker.ADD
    ]


def moving_of(message: MarkerArray) -> list[dict[str, Any]]:
    """Moving obstacles among the markers of a plan: position, diameters and destination.

    Of the diameters one is that of the obstacle, the other that of the disc that it may fill.
    """
    there = [each for each in message.markers[:_MOST_MARKERS] if each.action == Marker.ADD]
    ways = {each.id: each.points[-1] for each in there if each.type == Marker.ARROW and each.points}
    doubts = {each.id: each.scale.x for each in there if each.ns == 'moving_doubts'}
    return [
        {
            'at': [each.pose.position.x, each.pose.position.y],
            'size': each.scale.x,
            'doubt': doubts.get(each.id),
            'to': [ways[each.id].x, ways[each.id].y] if each.id in ways else None,
        }
        for each in there
        if each.ns == 'moving_obstacles'
    ]


def _short(text: str) -> str:
    return text[:_LONGEST_TEXT]
