"""The state of the guidance node and the times of its control steps, for /diagnostics."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus

from cmpsp_ros.guidance import response_ms
from cmpsp_ros.nodes.common.health import Report
from cmpsp_ros.nodes.guidance.lifecycle import ACTIVE
from cmpsp_ros.nodes.guidance.outputs.messages import level_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cmpsp_ros.nodes.guidance.loop import GuidanceLoop

_REMEMBERED_STEPS = 1000

_ENOUGH_STEPS = 10  # steps after which their usual delay is known
_LONGEST_GAP = 2.0  # control periods between two commands on a plan that are in time
_UNKNOWN_DELAY = 0.1  # control periods by which commands may be later than `command_delay` says


def report_on(
    state: str,
    refusal: str,
    loop: GuidanceLoop | None,
    warnings: Sequence[str] = (),
    errors: Sequence[str] = (),
) -> Report:
    """Report on the guidance node in a state, or on its `refusal` to leave it, with sentences."""
    decision = None if loop is None else loop.decision
    connections = {} if loop is None else loop.connections
    level, message = _state(state, refusal, loop)
    if loop is not None:
        said = [*warnings, *(loop.warnings() if state == ACTIVE else [])]
        if said and not refusal:
            level, message = max(level, DiagnosticStatus.WARN), ' '.join([message, *said])
        if state == ACTIVE and (
            said := [*filter(None, [loop.road.refusal, loop.map.refusal]), *errors]
        ):
            level, message = DiagnosticStatus.ERROR, ' '.join([message, *said])

    def figures() -> dict[str, object]:
        values: dict[str, object] = {'state': state, **connections}
        if decision is not None:
            level_name = decision.level.name.lower()
            values |= {'fallback_level': level_name, 'time_left': decision.time_left}
        if loop is None:
            return values
        if (age := loop.odometry_age) is not None:
            values['odometry_age'] = age
        counts = {f'odometry_{name}': count for name, count in loop.gate.counts.items()}
        return values | counts | loop.times.values()

    fallback = None if decision is None else decision.level
    return Report(level, message, (level, state, fallback, *connections.values()), figures)


def _state(state: str, refusal: str, loop: GuidanceLoop | None) -> tuple[bytes, str]:
    if refusal:
        return DiagnosticStatus.ERROR, refusal
    if loop is None or state != ACTIVE:
        return DiagnosticStatus.OK, f'The node is {state}.'
    lacking = loop.lacking
    if lacking or loop.decision is None:
        return DiagnosticStatus.WARN, lacking
    return level_of(loop.decision), loop.decision.reason


class StepTimes:
    """Computing times of the latest control steps, ages of odometry, and times to its command."""

    def __init__(self) -> None:
        self._times: deque[float] = deque(maxlen=_REMEMBERED_STEPS)
        self._answers: deque[float] = deque(maxlen=_REMEMBERED_STEPS)
        self._ages: deque[float] = deque(maxlen=_REMEMBERED_STEPS)
        self._misses, self._longest_gap = 0, 0.0

    def hear(self, age_ms: float) -> None:
        """Note the age of odometry on arrival [ms]; negative if ahead of the clock."""
        self._ages.append(age_ms)

    def add(
        self,
        step_ms: float,
        answer_ms: float,
        period: float,
        delay: float,
        *,
        gap: float = 0.0,
        is_late: bool = False,
    ) -> None:
        """Count a step: its time, and that from stamp to command [ms]; period and delay in [s].

        `gap` is the time since the last command [s], 0 where that did not follow a plan.
        """
        self._times.append(step_ms)
        self._longest_gap = max(self._longest_gap, gap)
        is_late = is_late or gap > _LONGEST_GAP * period
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
        values |= {'command_delay_measured': delay, 'command_gap_ms_max': 1e3 * self._longest_gap}
        return {**values, 'deadline_misses': self._misses}
