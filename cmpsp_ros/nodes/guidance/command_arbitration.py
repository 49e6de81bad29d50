"""Arbitration of commands: two guidance nodes must not command one robot.

The graph alone does not tell them apart. A node that waits to be activated has the same publishers
as one that drives, and one that was killed stays in the graph until the middleware drops it. So a
node announces that it guides, for as long as it does, on a topic beside that of the commands.
"""

import os
import socket
import time
from collections.abc import Callable
from uuid import uuid4

from diagnostic_msgs.msg import KeyValue
from rclpy.node import Node

from cmpsp_ros.nodes.common.topic import publisher_names, steady_timer
from cmpsp_ros.nodes.common.topics import COMMAND, GUIDED_BY

PERIOD = 0.5  # time between two claims [s]

# Time for which a claim is believed: a process that was killed makes no more [s].
TRUST = 4 * PERIOD


class CommandArbiter:
    """Other nodes that guide this robot, or at least publish commands to it."""

    def __init__(self, node: Node, give_way: Callable[[str], None]) -> None:
        """Listen; `give_way` is called with the name of a node that began to guide before."""
        self._node = node
        self._give_way = give_way
        self._commands = node.resolve_topic_name(COMMAND.name)
        # Beside the command's, wherever that has been remapped to.
        topic = f'{self._commands}/{GUIDED_BY.name.rpartition("/")[2]}'
        self._publisher = node.create_publisher(GUIDED_BY.type, topic, GUIDED_BY.qos)
        self._subscription = node.create_subscription(
            GUIDED_BY.type, topic, self._on_claim, GUIDED_BY.qos
        )
        self._timer = steady_timer(node, PERIOD, self._look)
        # Containers that share the network of their host may have equal process ids, too.
        process = f'{socket.gethostname()}:{os.getpid()}:{uuid4().hex[:8]}'
        self._name = f'{node.get_fully_qualified_name()} ({process})'
        self._since: int | None = None
        self._heard: dict[str, float] = {}
        self._others: tuple[str, ...] = ()
        self._look()

    @property
    def guiding(self) -> str:
        """Name of the node that lately guided this robot, '' if none."""
        oldest = time.monotonic() - TRUST
        return next((name for name, at in self._heard.items() if at >= oldest), '')

    @property
    def others(self) -> tuple[str, ...]:
        """Nodes in the graph that publish on the topic of the commands, this one left out."""
        return self._others

    def warnings(self) -> list[str]:
        """Warnings about others that publish commands, in sentences."""
        if not self._others:
            return []
        return [f'Others publish on {self._commands}, too: {", ".join(self._others)}.']

    def begin(self) -> None:
        """Say from now on that this node guides."""
        self._since = time.time_ns()
        self._look()

    def end(self) -> None:
        """Say so no more."""
        self._since = None

    def close(self) -> None:
        """Destroy timer, publisher and subscription."""
        self._node.destroy_timer(self._timer)
        self._node.destroy_publisher(self._publisher)
        self._node.destroy_subscription(self._subscription)

    def _look(self) -> None:
        if self._since is not None:
            self._publisher.publish(KeyValue(key=self._name, value=str(self._since)))
        own = self._node.get_fully_qualified_name()
        names = publisher_names(self._node, self._commands)
        # Another process may have a node of the same name.
        if own in names:
            names.remove(own)
        self._others = tuple(names)

    def _on_claim(self, claim: KeyValue) -> None:
        if claim.key == self._name:
            return
        self._heard[claim.key] = time.monotonic()
        # An order of beginning that both nodes see alike.
        since = int(claim.value) if claim.value.isdecimal() else 0
        if self._since is not None and (since, claim.key) < (self._since, self._name):
            self._give_way(claim.key)
