"""QP back ends held against independent solvers on many thousands of programs."""

from cmpsp_ros.studies.verify.errors import VerifyError
from cmpsp_ros.studies.verify.report import describe, mismatches, new_file, table, to_json
from cmpsp_ros.studies.verify.run import verify, verify_case

__all__ = [
    'VerifyError',
    'describe',
    'mismatches',
    'new_file',
    'table',
    'to_json',
    'verify',
    'verify_case',
]
