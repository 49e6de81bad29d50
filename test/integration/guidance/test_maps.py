"""Real nodes with a map in a file: drives on it, also past what only a scanner sees; refusals."""

import json
import sys
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticStatus

pytestmark = pytest.mark.integration

DOOR = Path(__file__).parents[3] / 'config' / 'door.yaml'
NODE = [sys.executable, '-m', 'cmpsp_ros.nodes.guidance.node', '--ros-args', '--params-file', DOOR]
PATIENT = ['-p', 'autostart:=true', '-p', 'odom_timeout:=60.0']


def test_it_begins_nothing_in_a_wall_and_drives_from_where_it_is_free(spawn, client, make_odometry):
    # Odometry is put somewhere else.
    spawn([*map(str, NODE), *PATIENT, '-p', 'safety.max_odom_jump:=0.0'])
    client.connect()
    client.until_health(state='active')

    begun = client.now()
    decision, command = client.decide(make_odometry(begun, (2.9, 1.0, 0.0), 'map'))

    assert command == (0.0, 0.0)
    assert 'inside obstacle map: nothing is begun there.' in decision['reason']
    later = begun + 200_000_000
    decision, command = client.decide(make_odometry(later, (1.0, 1.2, 0.0), 'map'))
    assert decision['fallback_level'] == 'nominal', decision['reason']
    assert command[0] > 0.1
    assert float(decision['terminal_error']) < 0.02


def test_a_map_that_is_not_there_is_refused_with_its_name(spawn, client):
    node = spawn([*map(str, NODE), *PATIENT, '-p', 'map.file:=none.yaml'])

    client.until_health(state='unconfigured', level=DiagnosticStatus.ERROR)

    assert 'cannot configure: none.yaml: found No such file or directory' in node.stderr


BESIDE_THE_MAP = {
    'goal.position': '[3.8, 3.0]',
    'final_time': '20.0',
    'sensors.names': '[front]',
    'sensors.front.reach': '6.0',
    'sim.scan.rate': '10.0',
    'sim.scan.stddev': '0.01',
    'sim.obstacles.names': '[crate]',
    'sim.obstacles.crate.type': 'polygon',
    'sim.obstacles.crate.vertices': '[2.9, 0.9, 3.5, 0.9, 3.5, 1.6, 2.9, 1.6]',
}
"""A scanner, and a crate of which only the simulator knows, in the way."""


def test_a_crate_that_is_not_on_the_map_is_seen_and_driven_round(spawn, tmp_path):
    cmpsp, folder = [sys.executable, '-m', 'cmpsp_ros.cli'], tmp_path / 'run'
    given = [part for item in BESIDE_THE_MAP.items() for part in ('--set', '='.join(item))]
    demo = spawn([*cmpsp, 'demo', 'warehouse', '--lockstep', '--output', folder, *given])
    # It judges the path by the crate as well.
    assert demo.wait() == 0, demo.stdout + demo.stderr
    assert json.loads((folder / 'summary.json').read_text())['clearance_m'] > 0.0
    again = spawn([*cmpsp, 'replay', folder / 'bag'])
    assert again.wait() == 0, again.stdout + again.stderr
    assert again.stdout.startswith('identical: ')
