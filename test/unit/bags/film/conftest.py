"""Films of the same drive that the audit is tested on."""

import pytest


@pytest.fixture(scope='session')
def bag(whole_drive, tmp_path_factory):
    """Case 3 from beginning to end."""
    return whole_drive.copy().write(tmp_path_factory.mktemp('film') / 'bag')
