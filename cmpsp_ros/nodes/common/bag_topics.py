"""Topics as bags have them: message classes by name, and quality of service."""

from __future__ import annotations

import re
from collections.abc import Iterable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)

from cmpsp_ros.bags import UnknownTypeError

_DEPTH, _MAX_DEPTH = 10, 10_000
_NAME = re.compile(r'([a-z][a-z0-9_]*)/msg/([A-Z][A-Za-z0-9]*)')


def hearing_all(offered: Iterable[QoSProfile], *, depth: int) -> QoSProfile:
    """Strictest request of a subscription that still hears every publisher.

    It is reliable if they all are, and transient local if they all are.
    """
    profiles = list(offered)
    reliable = all(each.reliability == ReliabilityPolicy.RELIABLE for each in profiles)
    latched = all(each.durability == DurabilityPolicy.TRANSIENT_LOCAL for each in profiles)
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def for_bag(profile: QoSProfile) -> Qos:
    """Convert a profile to the bag's form; both number the policies as the middleware does."""
    return Qos(
        QosHistory(int(profile.history)),
        profile.depth,
        QosReliability(int(profile.reliability)),
        QosDurability(int(profile.durability)),
        _time(profile.deadline),
        _time(profile.lifespan),
        QosLiveliness(int(profile.liveliness)),
        _time(profile.liveliness_lease_duration),
        profile.avoid_ros_namespace_conventions,
    )


def offering(recorded: Iterable[Qos]) -> QoSProfile:
    """Offer that reaches all subscribers that recorded publishers reached.

    It is reliable if any was, or none is known, and transient local if any was. Deadlines and
    lifespans are left out: a paused playback could not keep them.
    """
    profiles = list(recorded)
    reliable = any(each.reliability == QosReliability.RELIABLE for each in profiles)
    latched = any(each.durability == QosDurability.TRANSIENT_LOCAL for each in profiles)
    depth = max((each.depth for each in profiles), default=_DEPTH)
    return QoSProfile(
        depth=min(max(depth, 1), _MAX_DEPTH),
        reliability=ReliabilityPolicy.RELIABLE
        if reliable or not profiles
        else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def _time(duration: Duration) -> QosTime:
    return QosTime(*divmod(duration.nanoseconds, 10**9))


def message_class(name: str) -> Any:
    """Class of a type, such as `nav_msgs/msg/Odometry`; raises UnknownTypeError without it."""
    match = _NAME.fullmatch(name)
    # A bag may name any package; only one of messages is imported.
    if match and _has_messages(match[1]):
        found = getattr(import_module(f'{match[1]}.msg'), match[2], None)
        if found is not None:
            return found
    raise UnknownTypeError(f'found type {name!r}, wanted one that is installed here')


def _has_messages(package: str) -> bool:
    spec = find_spec(package)
    folders = (spec and spec.submodule_search_locations) or ()
    return any((Path(folder) / 'msg' / '__init__.py').is_file() for folder in folders)
