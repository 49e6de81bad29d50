"""Objects in the messages of other packages' trackers and detectors, with the z axis up.

Covariances become the standard deviation of their worst axis, shapes a disc that covers them.
"""

import math
from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from itertools import islice
from typing import Any, Final, NamedTuple, get_args, get_type_hints

from cmpsp_ros.guidance.messages.poses import check_frame, heading_of
from cmpsp_ros.guidance.messages.tracks import MAX_TRACKS, TrackError, tracks_of
from cmpsp_ros.guidance.times import NANOSECONDS
from cmpsp_ros.sensing import TrackSource, stamp_of

_YAW: Final = 35  # index of the variance of the heading in a covariance of 6 x 6
_CYLINDER, _POLYGON = 1, 2  # shapes of autoware_perception_msgs
_LATE: Final = 0.1  # difference of stamps of an object and its message that does not matter [s]
_UPRIGHT: Final = math.cos(math.radians(20.0))  # least cosine of the lean of a box that is upright
_TRACKED: Final = 1  # detection level of derived_object_msgs from which on a velocity is valid


class TrackedObject(NamedTuple):
    """An object in the frame of its message."""

    name: Hashable  # the same in each message; None where the message has none
    x: float  # place [m]
    y: float  # place [m]
    radius: float  # radius that covers it [m]; 0 where the message has no extent
    velocity: tuple[float, float] | None  # in the frame [m/s]; None where the message has none
    position_stddev: float = 0.0  # worst axis [m]; 0 where the message has none
    velocity_stddev: float = 0.0  # worst axis [m/s]; 0 where the message has none


def objects_of(message: Any, kind: str) -> list[TrackedObject]:
    """Objects in a message of a type such as `radar_msgs/msg/RadarTracks`, or TrackError.

    A name that occurs twice names nobody, as the id 0 of a costmap_converter without tracking.
    """
    found = list(islice(_CONVERTERS[kind](message), MAX_TRACKS + 1))
    if len(found) > MAX_TRACKS:
        raise TrackError(f'There are more than {MAX_TRACKS} objects, wanted that many at most.')
    counts = Counter(each.name for each in found)
    return [each._replace(name=None) if counts[each.name] > 1 else each for each in found]


def is_relative(kind: str) -> bool:
    """True if the velocities in messages of a type are relative to their frame, not over ground."""
    return kind == 'radar_msgs/msg/RadarTracks'


def _in_cloud(message: Any) -> Iterator[TrackedObject]:
    for each in tracks_of(message, message.header.frame_id):
        stddevs = each.position_stddev, each.velocity_stddev
        yield TrackedObject(each.id, each.x, each.y, each.radius, (each.vx, each.vy), *stddevs)


def _detections(message: Any) -> Iterator[TrackedObject]:
    """Objects of a `vision_msgs/Detection3DArray`; the surest hypothesis has the covariance."""
    for each in message.detections:
        _check_frame(message, each)
        place, size = each.bbox.center.position, each.bbox.size
        surest = max(each.results, key=lambda one: one.hypothesis.score, default=None)
        stddev = 0.0 if surest is None else _worst_axis(surest.pose.covariance, 7)
        yield TrackedObject(
            each.id or None,
            place.x,
            place.y,
            _of_box(size, each.bbox.center.orientation),
            None,
            stddev,
        )


def _autoware(message: Any) -> Iterator[TrackedObject]:
    """Objects of autoware's `TrackedObjects`, whose velocities are along their own axes."""
    for each in message.objects:
        posed, moved = each.kinematics.pose_with_covariance, each.kinematics.twist_with_covariance
        place, twist = posed.pose.position, moved.twist.linear
        turned, speed = posed.pose.orientation, math.hypot(twist.x, twist.y)
        if speed > 0.0 and not math.hypot(turned.x, turned.y, turned.z, turned.w) > 0.0:
            name = bytes(each.object_id.uuid).hex()
            raise TrackError(f'Object {name} moves without an orientation, wanted a quaternion.')
        heading = heading_of(turned)
        cosine, sine = math.cos(heading), math.sin(heading)
        velocity = cosine * twist.x - sine * twist.y, sine * twist.x + cosine * twist.y
        radius = _of_box(each.shape.dimensions, turned)
        if each.shape.type == _CYLINDER:
            radius = each.shape.dimensions.x / 2.0
        elif each.shape.type == _POLYGON:
            radius = _of_corners(each.shape.footprint.points)
        yield TrackedObject(
            bytes(each.object_id.uuid),
            place.x,
            place.y,
            radius,
            velocity,
            _worst_axis(posed.covariance, 7),
            # Of one whose heading is in doubt, so is the direction in which it moves.
            math.hypot(
                _worst_axis(moved.covariance, 7),
                speed * min(math.sqrt(max(posed.covariance[_YAW], 0.0)), 2.0),
            ),
        )


def _radar(message: Any) -> Iterator[TrackedObject]:
    """Objects of `radar_msgs/RadarTracks`, with velocities relative to the radar."""
    for each in message.tracks:
        yield TrackedObject(
            bytes(each.uuid.uuid),
            each.position.x,
            each.position.y,
            _of_box(each.size),
            (each.velocity.x, each.velocity.y),
            _worst_axis(each.position_covariance, 3),
            _worst_axis(each.velocity_covariance, 3),
        )


def _obstacles(message: Any) -> Iterator[TrackedObject]:
    """Objects of `costmap_converter_msgs/ObstacleArrayMsg`: points, lines and polygons."""
    for each in message.obstacles:
        _check_frame(message, each)
        corners = [(one.x, one.y) for one in each.polygon.points]
        if not corners:
            raise TrackError(f'Obstacle {each.id} has a polygon without points.')
        x, y = ((min(along) + max(along)) / 2.0 for along in zip(*corners, strict=True))
        radius = each.radius + max(math.dist((x, y), one) for one in corners)
        moved = each.velocities
        velocity, stddev = moved.twist.linear, _worst_axis(moved.covariance, 7)
        yield TrackedObject(each.id, x, y, radius, (velocity.x, velocity.y), 0.0, stddev)


def _derived(message: Any) -> Iterator[TrackedObject]:
    """Objects of `derived_object_msgs/ObjectArray`; one that is only detected has no velocity."""
    for each in message.objects:
        _check_frame(message, each)
        place, twist = each.pose.position, each.twist.linear
        velocity = (twist.x, twist.y) if each.detection_level == _TRACKED else None
        corners = (math.dist((one.x, one.y), (place.x, place.y)) for one in each.polygon.points)
        radius = max(_of_solid(each.shape), *corners, 0.0)
        yield TrackedObject(each.id, place.x, place.y, radius, velocity)


_CONVERTERS: Final[dict[str, Callable[[Any], Iterable[TrackedObject]]]] = dict(
    zip(
        get_args(get_type_hints(TrackSource)['type']),
        (_in_cloud, _detections, _autoware, _radar, _obstacles, _derived),
        strict=True,
    )
)


def _check_frame(message: Any, part: Any) -> None:
    """Refuse an object of another frame or time than the header of all, if it names one."""
    if part.header.frame_id:
        frame_id = message.header.frame_id
        check_frame('An object is', part.header.frame_id, frame_id, TrackError)
    off = (stamp_of(message) - stamp_of(part)) / NANOSECONDS
    if stamp_of(part) != 0 and abs(off) > _LATE:
        raise TrackError(f'An object was seen {off:.3f} s before its message, wanted its stamp.')


def _worst_axis(covariance: Sequence[float], yy: int) -> float:
    """Standard deviation along the worst axis in the plane, by the index of the second variance."""
    a, b, c = (float(covariance[each]) for each in (0, 1, yy))
    variance = (a + c) / 2.0 + math.hypot((a - c) / 2.0, b)
    return math.sqrt(variance) if variance > 0.0 else variance


def _of_box(size: Any, turned: Any = None) -> float:
    """Radius of a box; of one that leans, all around it."""
    height = 0.0
    if turned is not None:
        length = turned.x**2 + turned.y**2 + turned.z**2 + turned.w**2
        up = turned.w**2 + turned.z**2 - turned.x**2 - turned.y**2
        height = size.z if up < _UPRIGHT * length else 0.0
    return math.hypot(size.x, size.y, height) / 2.0


def _of_solid(shape: Any) -> float:
    """Radius of a `shape_msgs/SolidPrimitive`; 0 of one without dimensions."""
    sizes = list(shape.dimensions)
    if not sizes:
        return 0.0
    if shape.type == shape.BOX and len(sizes) > 1:
        return math.hypot(*sizes[:2]) / 2.0
    # That of a sphere is all, that of a cylinder and a cone comes after the height.
    return _of_corners(shape.polygon.points) if shape.type == shape.PRISM else float(sizes[-1])


def _of_corners(points: Iterable[Any]) -> float:
    return max((math.hypot(each.x, each.y) for each in points), default=0.0)
