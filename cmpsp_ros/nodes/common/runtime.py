"""Start and end of every process of this package.

A node ends by a signal, by a shut-down context or by an exception. In each case its `stop` method
runs while the ROS context is still valid, so the last zero twist is sent and a bag is closed.
"""

import math
import os
import select
import signal
import threading
import time
import traceback
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import rclpy
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.logging import get_logger
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from cmpsp_ros.nodes.common.interruptions import SIGNALS

# Longest wait for work [s]: an executor does not notice signals, so this bounds the answer.
WAKE_PERIOD = 0.05
# Longest wait at the end for subscribers to confirm what was published last [s].
DELIVERY_LIMIT = 0.5


class StartupError(ValueError):
    """A node cannot start as configured; the message says why."""


def run(
    make_node: Callable[[], Node],
    *,
    name: str,
    args: Sequence[str] | None = None,
    outlasts: float = 0.0,
) -> int:
    """Make a node, spin it until SIGINT or SIGTERM, and stop it in good order; the exit code.

    To be called in the main thread, as the last thing a process does: both signals stay
    ignored. The node's `stop` is called once; an exception in its `failure` ends it. A
    `ValueError` of `make_node` is logged by its message alone. It outlasts the process that it
    is to stop with by some time [s], in which the last command is driven, shown and recorded.
    """
    stopping = _stop_on_signal()
    logger = get_logger(name)
    try:
        rclpy.init(
            args=None if args is None else list(args),
            signal_handler_options=SignalHandlerOptions.NO,
        )
    except Exception as error:
        _log_fatal(logger, error)
        _ignore_signals()
        return 1
    try:
        return _live(make_node, stopping, logger, outlasts)
    finally:
        _ignore_signals()
        rclpy.try_shutdown()


def _live(
    make_node: Callable[[], Node], stopping: threading.Event, logger: RcutilsLogger, outlasts: float
) -> int:
    try:
        node = make_node()
    except ValueError as error:
        _log_fatal(logger, error, typed=False)
        return 1
    except Exception as error:
        _log_fatal(logger, error)
        return 1
    logger = node.get_logger()
    watch = ProcessWatch(node, outlasts)
    # It calls back in the order in which things happen. Others make the set of all they wait for
    # anew each time that they wake, which takes longer than the middleware takes for a message.
    executor = EventsExecutor()
    executor.add_node(node)
    healthy = True
    try:
        while not (stopping.is_set() or watch.is_over() or getattr(node, 'failure', None)):
            executor.spin_once(timeout_sec=WAKE_PERIOD)
    except ExternalShutdownException:
        pass
    except Exception as error:
        _log_fatal(logger, error)
        healthy = False
    if failure := getattr(node, 'failure', None):
        _log_fatal(logger, failure)
        healthy = False
    # A signal between here and the exit would interrupt the stop itself.
    _ignore_signals()
    stop = getattr(node, 'stop', None)
    ends = (stop, partial(_deliver, node), executor.shutdown, node.destroy_node)
    # Each is tried, even where the one before has failed.
    failed = [end for end in ends if end is not None and not _ends_well(end, logger)]
    return 0 if healthy and not failed else 1


def _deliver(node: Node) -> None:
    """Wait until reliable subscribers have received the last message: one destroyed drops it."""
    end = time.monotonic() + DELIVERY_LIMIT
    for publisher in sorted(node.publishers, key=lambda each: each.qos_profile.depth):
        left = max(0.0, end - time.monotonic())
        delivered = publisher.wait_for_all_acked(Duration(seconds=left))
        # Of deeper queues the middleware asks for confirmation only every few seconds.
        if not delivered and publisher.qos_profile.depth == 1:
            node.get_logger().warning(
                f'{publisher.topic_name}: a subscriber has not confirmed the last message'
            )


def _ends_well(end: Callable[[], object], logger: RcutilsLogger) -> bool:
    try:
        end()
    except Exception as error:
        _log_fatal(logger, error)
        return False
    return True


def _stop_on_signal() -> threading.Event:
    """Install the handlers; the returned event is set by the first signal."""
    stopping = threading.Event()

    def on_signal(_number: int, _frame: Any) -> None:
        # A launch system repeats the signal: the second one must not disturb the stop.
        _ignore_signals()
        stopping.set()

    for number in SIGNALS:
        signal.signal(number, on_signal)
    return stopping


def _ignore_signals() -> None:
    for number in SIGNALS:
        signal.signal(number, signal.SIG_IGN)


def _log_fatal(logger: RcutilsLogger, error: Exception, *, typed: bool = True) -> None:
    """Log an exception in one line, its traceback at debug level only."""
    text = ' '.join(str(error).split())
    logger.fatal(f'{type(error).__name__}: {text}' if typed or not text else text)
    logger.debug(''.join(traceback.format_exception(error)))


def overrides(node: Node) -> dict[str, Any]:
    """Values that the node was started with, by key."""
    # ROS silently drops misspelt arguments, and rclpy has no public way to see them.
    given = node._parameter_overrides  # noqa: SLF001
    return {key: each.value for key, each in given.items()}


class ProcessWatch:
    """Sees another process end (Linux only): that of the parameter `stop_with_process`."""

    def __init__(self, node: Node, outlasts: float) -> None:
        self._node, self._outlasts = node, outlasts
        self._process = overrides(node).get('stop_with_process', 0)
        self._handle: int | None = None
        self._ended_at = math.inf
        if self._process:
            try:
                self._handle = os.pidfd_open(self._process)
            except ProcessLookupError:
                self._ended_at = time.monotonic()

    def is_over(self) -> bool:
        """True once the process has ended and the time since then has passed."""
        # It can be read once the process has ended, waited for or not.
        if self._handle is not None and select.select([self._handle], [], [], 0.0)[0]:
            os.close(self._handle)
            self._handle, self._ended_at = None, time.monotonic()
        if time.monotonic() - self._ended_at < self._outlasts:
            return False
        self._node.get_logger().error(f'process {self._process} has ended, and so does this node')
        return True
