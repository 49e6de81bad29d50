"""What the guidance node says of its own state on /diagnostics."""

from __future__ import annotations

from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticStatus

from cmpsp_ros.nodes.common.health import Report
from cmpsp_ros.nodes.common.lifecycle import ACTIVE
from cmpsp_ros.nodes.guidance.outputs.messages import level_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from cmpsp_ros.nodes.guidance.loop import GuidanceLoop


def report_on(
    state: str,
    refusal: str,
    loop: GuidanceLoop | None,
    warnings: Sequence[str] = (),
    errors: Sequence[str] = (),
) -> Report:
    """Report on the guidance node.

    Args:
        state: Of its lifecycle.
        refusal: Why it would not go on to another one; empty when it would.
        loop: What it guides by, while it is configured.
        warnings: What is wrong beside that, in sentences.
        errors: The same, where it must not be.
    """
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
    if loop.decision is not None and not loop.waiting:
        return level_of(loop.decision), loop.decision.reason
    return DiagnosticStatus.WARN, loop.waiting or 'Waiting for odometry.'
