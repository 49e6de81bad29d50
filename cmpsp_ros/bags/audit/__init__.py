"""Audit of a bag: judges a drive by odometry and parameters alone."""

from cmpsp_ros.bags.audit.checks import CHECKS, audit, audit_record
from cmpsp_ros.bags.audit.finding import CheckOutcome, Finding, overall
from cmpsp_ros.bags.audit.output import remarks, table, write_junit
from cmpsp_ros.bags.audit.record import AuditRecord
from cmpsp_ros.bags.audit.sources import Sources, read_record
