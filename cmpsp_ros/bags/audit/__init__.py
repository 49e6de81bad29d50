"""Audit of a bag: judges a drive by odometry and parameters alone."""

from pathlib import Path
from typing import Final

from cmpsp_ros.bags.audit import command_checks as commands
from cmpsp_ros.bags.audit import path_checks as paths
from cmpsp_ros.bags.audit import promise_checks as promises
from cmpsp_ros.bags.audit import stop_checks as stops
from cmpsp_ros.bags.audit.finding import CheckOutcome, Finding, overall
from cmpsp_ros.bags.audit.output import remarks, table, write_junit
from cmpsp_ros.bags.audit.record import AuditRecord
from cmpsp_ros.bags.audit.sources import Sources, read_record

CHECKS: Final = (
    paths.road,
    paths.obstacles,
    paths.moving,
    paths.people,
    paths.others,
    paths.margin,
    stops.goal,
    commands.jumps,
    commands.finite,
    commands.wheel_limits,
    commands.acceleration,
    commands.jerk,
    commands.lateral_acceleration,
    commands.steering,
    paths.commanded,
    promises.promise,
    promises.unseen,
    commands.as_decided,
    commands.obeyed,
    stops.rate,
    stops.age,
    stops.silence,
    stops.stop_at_end,
    stops.reasons,
    stops.previous_plan,
    paths.nominal,
)


def audit(path: Path, sources: Sources | None = None) -> tuple[Finding, ...]:
    """Audit a bag by its odometry and parameters; one finding a check, in the order of `CHECKS`."""
    return audit_record(read_record(path, sources))


def audit_record(record: AuditRecord) -> tuple[Finding, ...]:
    """Audit a record that has been read."""
    return tuple(each.judge(record) for each in CHECKS)
