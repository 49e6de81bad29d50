"""A node's own state on /diagnostics."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock, ClockType

from cmpsp_ros.guidance import exact_repr, response_ms
from cmpsp_ros.nodes.common.topics import HEALTH

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from rclpy.node import Node

_PERIOD = 1.0
_CHANGE_PERIOD = 0.1
_REMEMBERED_STEPS = 1000

_ENOUGH_STEPS = 10
"""Steps after which their usual delay is known."""

_UNKNOWN_DELAY = 0.1
"""Control periods by which commands may be later than `command_delay` says."""


@dataclass(frozen=True)
class Report:
    """State of a node.

    Attributes:
        level: Level of `diagnostic_msgs/DiagnosticStatus`.
        message: The state in a sentence.
        marks: Values whose change is published at once.
        values: Figures, computed only when they are published; floats read back exactly.
    """

    level: bytes
    message: str
    marks: tuple[object, ...]
    values: Callable[[], Mapping[str, object]]


class Health:
    """Publishes a node's state once a second and whenever it has changed."""

    def __init__(self, node: Node, look: Callable[[], Report]) -> None:
        """Begin to publish; ``look`` is asked for the state ten times a second."""
        self._node = node
        self._look = look
        self._shown: tuple[object, ...] | None = None
        self._publisher = HEALTH.publish_on(node)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(_PERIOD, self.publish, clock=steady)
        node.create_timer(_CHANGE_PERIOD, self._publish_change, clock=steady)

    def publish(self) -> None:
        """Publish the state now."""
        report = self._look()
        self._shown = report.marks
        name = self._node.get_name()
        status = status_message(report.level, self._node, name, report.message, report.values())
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._publisher.publish(array)

    def _publish_change(self) -> None:
        if self._look().marks != self._shown:
            self.publish()


def hardware_id(node: Node) -> str:
    """Name of the robot that a node belongs to: its namespace."""
    return str(node.get_namespace().strip('/')) or 'robot'


def status_message(
    level: bytes, node: Node, kind: str, message: str, values: Mapping[str, object]
) -> DiagnosticStatus:
    """A diagnostic status; floats are written so that they read back bit for bit."""
    return DiagnosticStatus(
        level=level,
        name=f'{node.get_fully_qualified_name()}: {kind}',
        hardware_id=hardware_id(node),
        message=message,
        values=[KeyValue(key=key, value=exact_repr(value)) for key, value in values.items()],
    )


class StepTimes:
    """Computing times of the latest control steps, ages of odometry, and times to its command."""

    def __init__(self) -> None:
        """Begin without any step."""
        self._times: deque[float] = deque(maxlen=_REMEMBERED_STEPS)
        self._answers: deque[float] = deque(maxlen=_REMEMBERED_STEPS)
        self._ages: deque[float] = deque(maxlen=_REMEMBERED_STEPS)
        self._misses = 0

    def hear(self, age_ms: float) -> None:
        """Note the age of odometry when it came [ms]; negative where it is ahead of the clock."""
        self._ages.append(age_ms)

    def add(
        self,
        step_ms: float,
        answer_ms: float,
        period: float,
        delay: float,
        *,
        is_late: bool = False,
    ) -> None:
        """Count a step.

        Args:
            step_ms: Time that it took [ms].
            answer_ms: Time from the stamp of odometry to its command [ms].
            period: Control period [s].
            delay: Time from the stamp of odometry to the effect of its command, as known [s].
            is_late: Whether its command came too late to be sent.
        """
        self._times.append(step_ms)
        self._answers.append(answer_ms)
        self._period_ms, self._delay_ms = 1e3 * period, 1e3 * delay
        self._misses += is_late or response_ms(step_ms, answer_ms, delay) > self._period_ms

    def warnings(self) -> list[str]:
        """Warnings about the latest steps, in sentences."""
        if not self._times:
            return []
        said = []
        if self._times[-1] > self._period_ms:
            said.append(
                f'The last control step took {self._times[-1]:.1f} ms of the'
                f' {self._period_ms:.1f} ms until the next.'
            )
        if len(self._answers) >= _ENOUGH_STEPS:
            usual = float(np.median(self._answers))
            unknown, least_age = _UNKNOWN_DELAY * self._period_ms, min(self._ages, default=0.0)
            if usual - self._delay_ms > unknown:
                said.append(
                    f'Commands leave {usual:.0f} ms after their odometry:'
                    f' command_delay should be {usual / 1e3:.3f} s or more.'
                )
            if least_age - self._delay_ms > unknown:
                said.append(
                    f'Odometry is {least_age:.0f} ms old or more when it comes: the clock of the'
                    ' robot is behind, or the transport is slow.'
                )
            elif least_age < -unknown:
                said.append(
                    f'Odometry comes up to {-least_age:.0f} ms before its time: the clock of the'
                    ' robot is ahead.'
                )
        return said

    def values(self) -> dict[str, object]:
        """Percentiles of each [ms], the delay to be set as `command_delay` [s], and misses."""
        if not self._times:
            return {}
        values: dict[str, object] = {}
        for name, times in (('step', self._times), ('odometry_to_command', self._answers)):
            p50, p95 = np.percentile(times, [50, 95]).tolist()
            values[f'{name}_ms_p50'], values[f'{name}_ms_p95'] = p50, p95
            values[f'{name}_ms_max'] = max(times)
        if self._ages:
            least, p50, p99 = np.percentile(self._ages, [0, 50, 99]).tolist()
            latency = 'odometry_latency_ms'
            values |= {f'{latency}_min': least, f'{latency}_p50': p50, f'{latency}_p99': p99}
        delay = max(0.0, float(np.median(self._answers)) / 1e3)
        return {**values, 'command_delay_measured': delay, 'deadline_misses': self._misses}
