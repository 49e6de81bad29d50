"""Films of the same drive that the audit is tested on."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / 'audit'))


@pytest.fixture(scope='session')
def bag(tmp_path_factory):
    """Case 3 from beginning to end."""
    from drives import drive_case

    return drive_case().write(tmp_path_factory.mktemp('film') / 'bag')
