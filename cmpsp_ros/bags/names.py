"""Full names of a recorded guidance node and of its topics."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from cmpsp_ros.guidance.messages import PeerTrajectory


@dataclass(frozen=True)
class Names:
    """Topics and nodes of a recorded robot, by full name."""

    odom: str
    cmd_vel: str
    node: str  # guidance
    namespace: str = field(init=False)  # of the node, as in `/r1`
    decision: str = field(init=False)
    path: str = field(init=False)  # predicted paths
    tracks: str = field(init=False)  # moving obstacles as decisions use them
    sighting: str = field(init=False)  # known surroundings
    moving: str = field(init=False)  # moving obstacles as they are received
    sim: str = field(init=False)  # node of the simulator
    people: str = field(init=False)  # the simulator's people as they truly are

    def __post_init__(self) -> None:
        """Derive the other names."""
        node, namespace = self.node, self.node.rpartition('/')[0]
        vars(self).update(
            namespace=namespace,
            decision=f'{node}/decision',
            path=f'{node}/predicted_path',
            tracks=f'{node}/tracks',
            sighting=f'{node}/sighting',
            moving=f'{namespace}/moving_obstacles',
            sim=f'{namespace}/sim',
            people=f'{namespace}/sim/people',
        )

    @classmethod
    def under(cls, namespace: str, odom: str = '', cmd_vel: str = '') -> Names:
        """The names in a namespace, without remapping of odometry and commands."""
        prefix = namespace.rstrip('/')
        return cls(odom or f'{prefix}/odom', cmd_vel or f'{prefix}/cmd_vel', f'{prefix}/guidance')

    def others(self, namespaces: Iterable[str]) -> dict[str, str]:
        """Namespaces of other robots by the topics of their plans; without this node's own."""
        plans = {PeerTrajectory.topic(each): each for each in namespaces}
        plans.pop(self.path, None)
        return plans
