"""A node that ends with the process that started it, however that has ended."""

from __future__ import annotations

import os
import select
import signal
from typing import TYPE_CHECKING

from rclpy.clock import Clock, ClockType

if TYPE_CHECKING:
    from rclpy.node import Node

_PERIOD = 0.1


class ProcessWatch:
    """Asks this process to end, in good order, once another one has ended (Linux only)."""

    def __init__(self, node: Node, process: int) -> None:
        """Begin to watch.

        Args:
            node: The node that is to end.
            process: Number of the other process; 0 for none.
        """
        self._node, self._process = node, process
        if process:
            try:
                self._handle: int | None = os.pidfd_open(process)
            except ProcessLookupError:
                self._handle = None
            steady = Clock(clock_type=ClockType.STEADY_TIME)
            self._timer = node.create_timer(_PERIOD, self._look, clock=steady)
            self._look()

    def _look(self) -> None:
        # It can be read once the process has ended, waited for or not.
        if self._handle is not None and not select.select([self._handle], [], [], 0.0)[0]:
            return
        self._timer.cancel()
        self._node.get_logger().error(f'process {self._process} has ended, and so does this node')
        os.kill(os.getpid(), signal.SIGTERM)
