"""QP back ends held against independent solvers on many thousands of programs."""

from benchmarks.verify.errors import VerifyError
from benchmarks.verify.report import describe, mismatches, new_file, table, to_json
from benchmarks.verify.run import verify, verify_case

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
