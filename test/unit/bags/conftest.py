"""Drives for all tests of what reads bags."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent / 'audit'))


@pytest.fixture(scope='session')
def whole_drive():
    """Case 3 from beginning to end, as it should be."""
    from drives import drive_case

    return drive_case()


@pytest.fixture
def drive(whole_drive):
    """The same, to be tampered with."""
    return whole_drive.copy()
