"""Drives for all tests of the audit."""

import sys
from pathlib import Path

import pytest

from cmpsp_ros.bags.audit import audit

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture(scope='session')
def whole_drive():
    """Case 3 from beginning to end, as it should be."""
    from drives import drive_case

    return drive_case()


@pytest.fixture
def drive(whole_drive):
    """The same, to be tampered with."""
    return whole_drive.copy()


@pytest.fixture
def outcomes(tmp_path):
    """Audit a drive: findings by the name of their check."""

    def audited(drive, sources=None):
        return {each.check: each for each in audit(drive.write(tmp_path / 'bag'), sources)}

    return audited
