"""Audits of drives."""

import pytest

from cmpsp_ros.bags.audit import audit


@pytest.fixture
def outcomes(tmp_path):
    """Audit a drive: findings by the name of their check."""

    def audited(drive, sources=None):
        return {each.check: each for each in audit(drive.write(tmp_path / 'bag'), sources)}

    return audited
