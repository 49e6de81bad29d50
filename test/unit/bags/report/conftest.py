"""Reports on the same drives that the audit is tested on."""

import pytest


@pytest.fixture
def hostile(drive):
    """A drive whose texts try to get out of the page, or into it."""
    attack = (
        '</script><script>document.title="owned"</script><img src=x onerror=alert(1)> $x^{ &lt;'
    )
    drive.frame_id = drive.parameters['frame_id'] = attack
    drive.decisions = [each._replace(reason=f'{attack} {each.reason}') for each in drive.decisions]
    return drive
