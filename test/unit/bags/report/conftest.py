"""Reports on the same drives that the audit is tested on."""

import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / 'audit'))


@pytest.fixture(scope='session')
def whole_drive():
    """Case 3 from beginning to end."""
    from drives import drive_case

    return drive_case()


@pytest.fixture
def drive(whole_drive):
    """The same, to be tampered with."""
    return whole_drive.copy()


@pytest.fixture
def hostile(drive):
    """A drive whose texts try to get out of the page, or into it."""
    attack = (
        '</script><script>document.title="owned"</script><img src=x onerror=alert(1)> $x^{ &lt;'
    )
    drive.frame_id = drive.parameters['frame_id'] = attack
    drive.decisions = [each._replace(reason=f'{attack} {each.reason}') for each in drive.decisions]
    return drive
