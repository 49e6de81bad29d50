"""The list of checks, and running them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from cmpsp_ros.bags.audit import change_checks, command_checks, fallback_checks, path_checks
from cmpsp_ros.bags.audit.finding import Finding, Verdict, not_judged, skipped
from cmpsp_ros.bags.audit.record import AuditRecord, read_record
from cmpsp_ros.bags.audit.sources import Sources
from cmpsp_ros.parameters import road_keys

_ROAD: Final = ('road',)
"""Stands for what describes a road of the type at hand."""

_WHEELS: Final = ('robot.wheel_radius', 'robot.half_track', 'robot.max_wheel_speed')


@dataclass(frozen=True)
class _Check:
    name: str
    title: str
    judge: Callable[[AuditRecord], Verdict]
    needs: tuple[str, ...] = ()
    of_decisions: bool = False


CHECKS: Final = (
    _Check('road', 'Path: inside the road', path_checks.road, _ROAD),
    _Check('obstacles', 'Path: clear of obstacles', path_checks.obstacles, ('obstacles.names',)),
    _Check('moving', 'Path: moving obstacles clear', path_checks.moving),
    _Check('others', 'Path: clear of other robots', path_checks.others),
    _Check('margin', 'Path: margin kept', path_checks.margin, (*_ROAD, 'safety.margin')),
    _Check(
        'goal',
        'Path: goal at the final time',
        path_checks.goal,
        ('goal.position', 'goal.tolerance', 'final_time'),
    ),
    _Check('jumps', 'Odometry: no jumps', path_checks.jumps, _WHEELS),
    _Check('finite', 'Commands: finite', command_checks.finite),
    _Check('wheel_limits', 'Commands: wheel limits', command_checks.wheel_limits, _WHEELS),
    _Check(
        'acceleration',
        'Commands: acceleration',
        change_checks.acceleration,
        (*_WHEELS[:2], 'control_period'),
    ),
    _Check('steering', 'Commands: steering', change_checks.steering, ('control_period',)),
    _Check(
        'commanded', 'Commands: safe to drive', path_checks.commanded, (*_ROAD, 'control_period')
    ),
    _Check('as_decided', 'Commands: as decided', command_checks.as_decided, _WHEELS[:2], True),
    _Check('obeyed', 'Commands: obeyed', command_checks.obeyed, (*_WHEELS, 'control_period')),
    _Check('rate', 'Commands: in time', command_checks.rate, ('control_period', 'final_time')),
    _Check('age', 'Commands: fresh odometry', command_checks.age, ('odom_timeout',)),
    _Check('silence', 'Stop: without odometry', command_checks.silence, ('odom_timeout',)),
    _Check('stop_at_end', 'Stop: at the end', fallback_checks.stop_at_end, ('control_period',)),
    _Check('reasons', 'Fallback: reasons given', fallback_checks.reasons, (), True),
    _Check(
        'previous_plan',
        'Fallback: old plans dropped',
        fallback_checks.previous_plan,
        ('failure_tolerance',),
        True,
    ),
    _Check('nominal', 'Fallback: nominal is clear', fallback_checks.nominal, _ROAD, True),
)


def audit(path: Path, sources: Sources | None = None) -> tuple[Finding, ...]:
    """Audit a bag, trusting nothing but its odometry and the parameters.

    Args:
        path: The bag.
        sources: Topics and parameters, where they are not the usual ones.

    Returns:
        One finding a check, in the order of `CHECKS`.

    Raises:
        BagError: The bag cannot be audited.
        ParameterError: The parameters cannot be used.
    """
    return audit_record(read_record(path, sources))


def audit_record(record: AuditRecord) -> tuple[Finding, ...]:
    """Audit a record that has been read."""
    return tuple(
        Finding(check=each.name, title=each.title, **vars(_judge(each, record))) for each in CHECKS
    )


def _judge(check: _Check, record: AuditRecord) -> Verdict:
    values = record.history.epochs[0].values
    needs = [
        key for need in check.needs for key in (road_keys(values) if need == 'road' else [need])
    ]
    missing = [key for key in needs if key not in record.history.given]
    if missing:
        return not_judged(f'The parameters do not say {", ".join(missing)}.')
    if check.of_decisions and not record.decisions:
        missing_decisions = f'The bag has no decision in {record.places.decision}.'
        # Another robot makes none.
        return not_judged(missing_decisions) if record.is_ours else skipped(missing_decisions)
    return check.judge(record)
