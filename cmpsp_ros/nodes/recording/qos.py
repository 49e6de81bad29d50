"""Quality of service of recorded topics: of subscriptions, in bags, and when played."""

from collections.abc import Sequence

from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags import interfaces as bag

from cmpsp_ros.nodes.common.topic import quality

_DEPTH, _MAX_DEPTH = 10, 10_000


def hearing_all(offered: Sequence[QoSProfile], *, depth: int) -> QoSProfile:
    """Strictest request of a subscription that still hears every publisher."""
    reliable = all(each.reliability == ReliabilityPolicy.RELIABLE for each in offered)
    latched = all(each.durability == DurabilityPolicy.TRANSIENT_LOCAL for each in offered)
    return quality(depth, reliable=reliable, latched=latched)


def for_bag(profile: QoSProfile) -> bag.Qos:
    """Convert a profile to the bag's form; both number the policies as the middleware does."""
    return bag.Qos(
        bag.QosHistory(int(profile.history)),
        profile.depth,
        bag.QosReliability(int(profile.reliability)),
        bag.QosDurability(int(profile.durability)),
        _time(profile.deadline),
        _time(profile.lifespan),
        bag.QosLiveliness(int(profile.liveliness)),
        _time(profile.liveliness_lease_duration),
        profile.avoid_ros_namespace_conventions,
    )


def offering(recorded: Sequence[bag.Qos]) -> QoSProfile:
    """Offer that reaches all subscribers that recorded publishers reached.

    Deadlines and lifespans are left out: a paused playback could not keep them.
    """
    reliable = any(each.reliability == bag.QosReliability.RELIABLE for each in recorded)
    latched = any(each.durability == bag.QosDurability.TRANSIENT_LOCAL for each in recorded)
    depth = max((each.depth for each in recorded), default=_DEPTH)
    depth = min(max(depth, 1), _MAX_DEPTH)
    return quality(depth, reliable=reliable or not recorded, latched=latched)


def _time(duration: Duration) -> bag.QosTime:
    return bag.QosTime(*divmod(duration.nanoseconds, 10**9))
