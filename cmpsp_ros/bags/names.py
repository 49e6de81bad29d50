"""Full names of a recorded guidance node and of its topics."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from cmpsp_ros.guidance.messages import PeerTrajectory


@dataclass(frozen=True)
class Names:
    """Topics and node of a recorded guidance node, by full name."""

    odom: str
    cmd_vel: str
    node: str

    @classmethod
    def under(cls, namespace: str, odom: str = '', cmd_vel: str = '') -> Names:
        """The names in a namespace, without remapping of odometry and commands."""
        prefix = namespace.rstrip('/')
        return cls(odom or f'{prefix}/odom', cmd_vel or f'{prefix}/cmd_vel', f'{prefix}/guidance')

    @property
    def decision(self) -> str:
        """Topic of the decisions."""
        return f'{self.node}/decision'

    @property
    def path(self) -> str:
        """Topic of the predicted paths."""
        return f'{self.node}/predicted_path'

    @property
    def moving(self) -> str:
        """Topic of the obstacles that move."""
        return f'{self.namespace}/moving_obstacles'

    @property
    def tracks(self) -> str:
        """Topic of the tracks of moving obstacles, as decisions use them."""
        return f'{self.node}/tracks'

    @property
    def people(self) -> str:
        """Topic of the simulator's people as they truly are."""
        return f'{self.sim}/people'

    @property
    def sighting(self) -> str:
        """Topic of the known surroundings."""
        return f'{self.node}/sighting'

    @property
    def sim(self) -> str:
        """Node of the simulator."""
        return f'{self.namespace}/sim'

    @property
    def namespace(self) -> str:
        """Namespace of the node, as in `/r1`."""
        return self.node.rpartition('/')[0]

    def others(self, namespaces: Iterable[str]) -> dict[str, str]:
        """Namespaces of other robots by the topics of their plans; without this node's own."""
        plans = {PeerTrajectory.topic(each): each for each in namespaces}
        plans.pop(self.path, None)
        return plans
