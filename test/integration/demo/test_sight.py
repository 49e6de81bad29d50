"""A run on scans alone: it arrives, clear of what guidance was not told of, and replays."""

from __future__ import annotations

import json

import pytest
from demo_folder import LIMIT

from cmpsp_ros.bags import Bag

pytestmark = pytest.mark.integration


@pytest.mark.parametrize('preset', ['unknown', 'clutter'])
def test_obstacles_that_only_a_scanner_sees_in_lockstep(start_demo, judge, tmp_path, preset):
    folder = tmp_path / 'run'
    running = start_demo(preset, '--lockstep', '--output', folder)
    assert running.wait(LIMIT) == 0, running.stdout + running.stderr
    summary = json.loads((folder / 'summary.json').read_text())
    # By all that stands there.
    assert 0.0 < summary['clearance_m'] < 0.3
    assert summary['miss_m'] < 0.01
    with Bag(folder / 'bag') as bag:
        assert bag.topics['/scan'].count > 250
        assert bag.topics['/guidance/sighting'].count >= 130
    judge(folder / 'bag')
