"""Real nodes with a map: from a file and on a topic, and past what only a scanner sees."""

import json
import math
import sys
from array import array
from pathlib import Path

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from live import LATCHED, PERIOD_NS, transform
from nav_msgs.msg import OccupancyGrid
from rclpy.time import Time

from cmpsp_ros.bags.audit import CheckOutcome, audit
from cmpsp_ros.robots.motion import arc_ends

START = (0.0, 0.0, 0.0)

# Odometry is stamped ahead of time here, and the test may be slow between two messages.
TOLD = {
    'road.type': 'none',
    'frame_id': 'map',
    'goal.position': [4.0, 0.0],
    'final_time': 20.0,
    'initial_guess.type': 'road',
    'robot.radius': 0.2,
    'safety.margin': 0.05,
    'odom_timeout': 60.0,
    'map.topic': 'floor',
}


def floor(*boxes, stamp=0, frame_id='map', **changes):
    """A floor of 8 x 6 m that is turned by a quarter, with boxes of cells."""
    cells = np.zeros((80, 60), np.int8)
    for rows, columns in boxes:
        cells[rows, columns] = 100
    message = OccupancyGrid(data=array('b', cells.tobytes()))
    message.header.frame_id = frame_id
    message.header.stamp = Time(nanoseconds=stamp).to_msg()
    message.info.resolution, message.info.height, message.info.width = 0.1, 80, 60
    # Its rows go along y, and its columns along -x: cell (0, 0) is at the lower right.
    message.info.origin.position.x, message.info.origin.position.y = -2.0, 3.0
    message.info.origin.orientation.z = -math.sqrt(0.5)
    message.info.origin.orientation.w = math.sqrt(0.5)
    for key, value in changes.items():
        setattr(message.info, key, value)
    return message


def nowhere():
    message = floor()
    message.info.origin.position.x = math.nan
    return message


BOX = np.s_[35:40], np.s_[26:34]
"""From 1.5 to 2 m ahead, and 0.4 m to either side."""

GOAL = np.s_[55:65], np.s_[25:35]

REFUSED = (
    (floor(width=0), 'cells: found 80 x 0'),
    (floor(width=100_000, height=10_000), 'cells: found 10000 x 100000'),
    (floor(width=61), 'data: found 4800 values, wanted 4880'),
    (nowhere(), 'origin: found'),
    (floor(resolution=0.0), 'resolution: found'),
    (floor((np.s_[:], np.s_[:])), 'map.cells: found none that is free'),
    (floor(GOAL), 'goal.position: found'),
    (floor(frame_id='elsewhere'), 'refused: tf2_msgs, for a transform'),
)


@pytest.fixture
def tell(client):
    """Publish a map: `tell(message)`."""
    return client.teller(OccupancyGrid, 'floor', LATCHED)


def test_a_map_is_waited_for_and_a_bad_one_stops_the_robot(
    fault, start_node, client, make_odometry, tell
):
    running = start_node('guidance_node', TOLD)
    client.connect()
    health = client.until_health(state='active', said='Waiting for a map on the topic floor.')
    fault.assert_told(health)
    stamp = client.now()
    client.send(stamp, START)
    for message, reason in REFUSED:
        tell(message)
        health = client.until_health(level=DiagnosticStatus.ERROR, said=reason)
        fault.assert_told(health)
    # The odometry has come long ago, and no drive of it.
    assert (client.decisions, client.commands) == ([], [])
    tell(floor(BOX))
    client.until_health(level=DiagnosticStatus.WARN, said='Waiting for odometry')
    decision, command = client.decide(make_odometry(stamp := stamp + PERIOD_NS, START, 'map'))
    assert decision['fallback_level'] == 'nominal', decision['reason']
    assert abs(command[1]) > 0.1, 'it turns to one side of the box'
    tell(REFUSED[2][0])
    client.until_health(level=DiagnosticStatus.ERROR, said=REFUSED[2][1])
    decision, command = client.decide(make_odometry(stamp := stamp + PERIOD_NS, START, 'map'))
    fault.assert_decided(decision)
    assert command == (0.0, 0.0)
    assert 'The map that came is refused: data: found 4800 values' in decision['reason']
    tell(floor())

    def drives():
        nonlocal stamp, command
        decision, command = client.decide(make_odometry(stamp := stamp + PERIOD_NS, START, 'map'))
        return decision['fallback_level'] == 'nominal'

    client.until(drives)
    assert abs(command[1]) < 0.05, 'nothing is in its way'
    assert 'Traceback' not in running.stderr


def test_a_costmap_grows_old_and_its_changes_count(
    interfaces, fault, start_node, client, make_odometry, tell
):
    interfaces('map_msgs')
    from map_msgs.msg import OccupancyGridUpdate

    start_node('guidance_node', {**TOLD, 'map.timeout': 0.5})
    client.connect()
    client.until_health(state='active', said='Waiting for a map')
    updates = client.node.create_publisher(OccupancyGridUpdate, 'floor_updates', 10)
    client.until(updates.get_subscription_count)
    stamp = client.now()
    tell(floor(stamp=stamp))
    client.until_health(said='Waiting for odometry')
    decision, command = client.decide(make_odometry(stamp, START, 'map'))
    assert decision['fallback_level'] == 'nominal', decision['reason']
    assert abs(command[1]) < 0.05, 'nothing is in its way'

    late = stamp + 4 * PERIOD_NS
    decision, command = client.decide(make_odometry(late, START, 'map'))
    fault.assert_decided(decision)
    assert command == (0.0, 0.0)
    assert decision['reason'].startswith('The map is 0.800 s old (map.timeout).')

    update = OccupancyGridUpdate(x=26, y=35, width=8, height=5, data=[100] * 40)
    update.header.stamp, update.header.frame_id = Time(nanoseconds=late).to_msg(), 'map'
    revision = int(decision['revision'])
    updates.publish(update)

    def with_change():
        nonlocal late, decision, command
        late += PERIOD_NS // 10
        decision, command = client.decide(make_odometry(late, START, 'map'))
        return int(decision['revision']) > revision

    client.until(with_change)
    assert decision['fallback_level'] == 'nominal', decision['reason']
    assert abs(command[1]) > 0.1, 'it turns to one side of the box'


def test_a_costmap_of_a_time_to_come_stops_the_robot(
    fault, start_node, client, make_odometry, tell
):
    """It would not grow old for as long."""
    start_node('guidance_node', {**TOLD, 'map.timeout': 0.5})
    client.connect()
    client.until_health(state='active', said='Waiting for a map')
    stamp = client.now()
    tell(floor(stamp=stamp + 3 * PERIOD_NS))
    client.until_health(said='Waiting for odometry')
    decision, command = client.decide(make_odometry(stamp, START, 'map'))
    fault.assert_decided(decision)
    assert command == (0.0, 0.0)
    assert ' s, 0.600 s ahead of odometry of ' in decision['reason']
    decision, _ = client.decide(make_odometry(stamp + PERIOD_NS, START, 'map'))
    assert decision['fallback_level'] == 'nominal', decision['reason']


def test_a_map_in_another_frame_is_placed_by_transforms(
    interfaces, start_node, client, make_odometry, tell
):
    interfaces('tf2_msgs')
    from tf2_msgs.msg import TFMessage

    start_node('guidance_node', TOLD)
    client.connect()
    client.until_health(state='active', said='Waiting for a map')
    # In `map` it is the floor with the box ahead, turned by 0.6 rad and moved.
    heading, x, y = 0.6, 1.0, -0.5
    message = floor(BOX, frame_id='building')
    origin = message.info.origin
    dx, dy = origin.position.x - x, origin.position.y - y
    origin.position.x = math.cos(heading) * dx + math.sin(heading) * dy
    origin.position.y = math.cos(heading) * dy - math.sin(heading) * dx
    turned = -math.pi / 2.0 - heading
    origin.orientation.z, origin.orientation.w = math.sin(turned / 2.0), math.cos(turned / 2.0)
    tell(message)
    health = client.until_health(level=DiagnosticStatus.ERROR, said='The map that came is refused')
    assert 'building' in health['said']

    there = transform('map', 'building', (x, y, heading))
    client.node.create_publisher(TFMessage, '/tf_static', LATCHED).publish(
        TFMessage(transforms=[there])
    )
    stamp, decisions = client.now(), []

    def drives():
        nonlocal stamp
        client.send(stamp := stamp + PERIOD_NS, START)
        decisions[:] = client.decisions
        return decisions

    client.until(drives)
    decision, command = client.recover(stamp + PERIOD_NS, START, 'map')
    assert decision['fallback_level'] == 'nominal', decision['reason']
    assert abs(command[1]) > 0.1, 'it turns to one side of the box'


def test_a_drive_on_maps_that_change_is_replayed_and_audited(
    start_active, client, record, make_odometry, tell
):
    recording = record()
    start_active(TOLD)
    recording.until_all_is_heard()
    pose, stamp, revisions = np.array(START), client.now(), []
    for step in range(30):
        if step in (0, 10):
            tell(floor(*[BOX] * (step > 0)))
            client.until_health(said='Waiting for odometry' if step == 0 else '')
        decision, command = client.decide(make_odometry(stamp, pose, 'map'))
        assert decision['fallback_level'] in {'nominal', 'previous_plan'}, decision
        revisions.append(int(decision['revision']))
        pose = arc_ends(pose[None], np.array([command]), np.array([0.2]))[0]
        stamp += PERIOD_NS
    assert len(set(revisions)) == 2
    assert recording.replayed().decisions == 30
    found = {each.check: each.outcome for each in audit(recording.bag)}
    assert found['as_decided'] is CheckOutcome.PASSED


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

    assert 'cannot configure: map.file: found no file' in node.stderr
    assert 'none.yaml' in node.stderr


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
