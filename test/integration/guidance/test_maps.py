"""Real nodes with a map in a file: drives on it, also past what only a scanner sees; refusals."""

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


"""A scanner, and a crate of which only the simulator knows, in the way."""
