"""The audit of a bag: what really happened, whatever the nodes said about it."""

from cmpsp_ros.bags.audit.checks import audit, audit_record
from cmpsp_ros.bags.audit.finding import Finding, Outcome
from cmpsp_ros.bags.audit.output import remarks, table, write_junit
from cmpsp_ros.bags.audit.record import Record, read_record
from cmpsp_ros.bags.audit.sources import Sources

__all__ = [
    'Finding',
    'Outcome',
    'Record',
    'Sources',
    'audit',
    'audit_record',
    'read_record',
    'remarks',
    'table',
    'write_junit',
]
