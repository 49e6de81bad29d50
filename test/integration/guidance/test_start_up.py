"""Start of the guidance node: compiled, with or without its core, and where a run begins."""

import os
import shutil
import signal
import sys
import time
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import TwistStamped
from live import CASE3, LATCHED, MS
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from visualization_msgs.msg import MarkerArray

from cmpsp_ros.mpsp.jit import kernel_folder
from cmpsp_ros.nodes.common.topics import COMMAND, DECISION, OWN_TRACKS, SIGHTING, WHEELS

ANNOUNCED = 'compiling, once; `cmpsp warmup` does it beforehand'

# Without CAP_SYS_NICE, whoever runs the tests.
POWERLESS = """
import ctypes, os, resource, sys
ctypes.CDLL(None).prctl(24, 23, 0, 0, 0)
resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
os.execv(sys.executable, [sys.executable, *sys.argv[1:]])
"""


def scheduling(thread):
    policy = os.sched_getscheduler(thread) & ~os.SCHED_RESET_ON_FORK
    return policy, os.sched_getaffinity(thread)


@pytest.fixture
def cache_without_the_audit(monkeypatch, tmp_path):
    """A cache of kernels of its own, in which those of one file are missing."""
    folder = kernel_folder()
    kept = tmp_path / 'cache' / folder.parent.name / folder.name
    shutil.copytree(folder, kept)
    missing = [*kept.glob('cmpsp_ros.guidance.safety.plan_sweep.*')]
    assert missing
    for each in missing:
        each.unlink()
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tmp_path / 'cache'))


@pytest.mark.timeout(300)
@pytest.mark.usefixtures('cache_without_the_audit')
def test_it_compiles_before_it_is_active_once_for_all_processes(start_node, make_client):
    for place, announced in (('/first', 1), ('/second', 0)):
        client = make_client(prefix=place)
        running = start_node('guidance_node', {}, '-r', f'__ns:={place}')
        client.until_health(240.0, state='active')
        assert running.stderr.count(ANNOUNCED) == announced
        assert running.stderr.count(' kernels in ') == announced


def test_the_deciding_thread_alone_has_its_core_while_the_node_is_active(start_node, client):
    everything, core = os.sched_getaffinity(0), min(os.sched_getaffinity(0))
    running = start_node('guidance_node', {'realtime.priority': 7, 'realtime.cpu': core})
    client.until_health(state='active')
    threads = [int(each.name) for each in Path(f'/proc/{running.pid}/task').iterdir()]
    others = [thread for thread in threads if thread != running.pid]
    assert others
    policy, cpus = scheduling(running.pid)
    assert cpus == {core}
    refused = 'realtime.priority = 7 was refused' in running.stderr
    assert policy == (os.SCHED_OTHER if refused else os.SCHED_FIFO)
    assert {scheduling(each)[0] for each in others} == {os.SCHED_OTHER}
    assert any(scheduling(each)[1] == everything for each in others)
    assert client.change_state('deactivate')
    assert scheduling(running.pid) == (os.SCHED_OTHER, everything)


def test_without_the_right_to_a_priority_it_says_so_and_guides_all_the_same(
    fault, spawn, client, make_odometry
):
    node = ['-m', 'cmpsp_ros.nodes.guidance.node', '--ros-args', '--params-file', CASE3]
    flags = ['-p', 'realtime.priority:=7', '-p', 'odom_timeout:=60.0', '-p', 'autostart:=true']
    running = spawn([sys.executable, '-c', POWERLESS, *node, *flags])
    client.connect()
    client.until_health(state='active', level=DiagnosticStatus.WARN)
    (said,) = [line for line in running.stderr.splitlines() if 'realtime' in line]
    for words in ('[WARN]', 'realtime.priority = 7 was refused', 'rtprio', 'CAP_SYS_NICE'):
        assert words in said
    fault.assert_said('—', 1, said.partition('[guidance]: ')[2])
    decision, command = client.decide(make_odometry(client.now(), (0.0, -9.25, 0.0)))
    assert decision['fallback_level'] == 'nominal'
    assert command[0] > 0.5


def test_a_core_that_is_not_there_is_refused(fault, start_node, client):
    running = start_node('guidance_node', {'realtime.cpu': 4095})
    health = client.until_health(level=DiagnosticStatus.ERROR)
    fault.assert_told(health)
    assert health['state'] == 'unconfigured'
    assert 'Traceback' not in running.stderr


@pytest.mark.smoke
def test_without_a_course_it_configures_says_what_is_missing_and_does_not_set_off(
    fault, spawn, client
):
    """As with a parameter file that is not there: ROS then goes on without."""
    node = ['-m', 'cmpsp_ros.nodes.guidance.node', '--ros-args', '-p', 'autostart:=true']
    running = spawn([sys.executable, *node])
    health = client.until_health(state='inactive', level=DiagnosticStatus.ERROR)
    lines = health['said'].splitlines()
    assert [line.partition(':')[0] for line in lines] == ['No course'] * 2
    for line, key in zip(lines, ('road.type', 'goal.position'), strict=True):
        assert key in line
        assert f'cannot activate: {line}' in running.stderr
        fault.assert_said('—', health['level'][0], line)
    client.drive()
    assert not client.change_state('activate')
    assert client.set_parameter('goal.position', [10.0, 0.0]).successful
    assert not client.change_state('activate')
    assert not client.commands
    # What has been refused is not yet done by itself once all is there.
    assert client.set_parameter('road.outer_radius', 11.0).successful
    client.until_health(state='inactive')
    assert client.change_state('activate')
    client.until_driving()


def test_by_itself_it_only_waits(start_node, client):
    start_node('guidance_node', {'autostart': False})
    refused = client.reset()
    assert (refused.success, refused.message) == (False, 'The node is unconfigured.')
    assert client.change_state('configure')
    assert client.reset().success
    client.until_health(state='inactive', level=DiagnosticStatus.OK)
    assert not client.commands


def test_a_changed_scene_is_shown_to_all_before_the_first_odometry(start_node, client):
    start_node()
    client.until_health(state='active')
    assert client.set_parameter('goal.position', [10.2, 0.0]).successful
    late = []
    client.node.create_subscription(MarkerArray, '/guidance/markers', late.append, LATCHED)

    def goal():
        found = [each for array in late[-1:] for each in array.markers if each.ns == 'goal']
        return found and found[0].pose.position.x == 10.2

    client.until(goal)


PATIENT = {'odom_timeout': 60.0, 'safety.max_odom_jump': 0.0}


@pytest.mark.smoke
def test_off_the_road_no_run_begins_until_the_robot_is_on_it(
    fault, start_active, client, make_odometry
):
    """Most odometry begins at (0, 0, 0), wherever the course is."""
    start_active(PATIENT)
    decision, command = client.decide(make_odometry(client.now(), (0.0, 0.0, 0.0)))
    assert command == (0.0, 0.0)
    fault.assert_decided(decision)
    assert '9 m off the road, more than 0.5 m (start.tolerance)' in decision['reason']
    decision, command = client.decide(make_odometry(client.now(), (0.0, -9.25, 0.0)))
    assert (decision['step'], decision['fallback_level']) == ('0', 'nominal')
    assert float(decision['time_left']) == 10.0
    assert command[0] > 0.5
    # Once it has begun it is led back from anywhere.
    later = client.now() + 200 * MS
    decision, command = client.decide(make_odometry(later, (0.0, -12.0, 0.0)))
    assert command != (0.0, 0.0)


def test_the_clock_stops_the_robot_and_odometry_judges_the_goal(
    fault, start_active, client, make_odometry
):
    start_active({'odom_timeout': 5.0, 'final_time': 1.0})
    begun = client.now()
    client.decide(make_odometry(begun, (0.0, -9.25, 0.0)))
    client.until(lambda: client.decisions[-1]['finished'] == 'true')
    stop = client.decisions[-1]
    assert (stop['halted'], client.commands[-1]) == ('true', (0.0, 0.0))
    assert 1000 * MS < int(stop['stamp']) - begun < 1500 * MS
    fault.assert_decided(stop)
    decision, command = client.decide(make_odometry(client.now(), (0.0, -9.25, 0.0)))
    assert (decision['finished'], decision['halted']) == ('true', 'false')
    assert 'm from the goal' in decision['reason']
    assert command == (0.0, 0.0)


def test_what_cannot_be_done_is_foretold_by_the_node(start_active, client, make_odometry):
    start_active({'final_time': 5.0, 'cmd_vel_timeout': 0.1})
    decision, _ = client.decide(make_odometry(client.now(), (0.0, -9.25, 0.0)))
    assert 'The goal is out of reach by ' in decision['reason']
    health = client.until_health(said='The goal is out of reach by ')
    assert 'control_period = 0.2 s is not shorter than cmd_vel_timeout = 0.1 s' in health['said']
    assert health['level'] != b'\x00'


def test_a_run_begins_with_the_newest_odometry(start_active, client):
    """With one that came while the node was busy, the first command would be late."""
    running = start_active(PATIENT)
    client.until_health(said='Waiting for odometry')
    end, newest = 0.0, []

    def begins():
        nonlocal end
        # The transport may lose what is sent to a process that stands still.
        if time.monotonic() > end:
            running.signal(signal.SIGSTOP)
            stamps = [client.now() - age * MS for age in (150, 100, 50, 0)]
            for each in stamps:
                client.send(each)
            running.signal(signal.SIGCONT)
            newest.append(stamps[-1])
            end = time.monotonic() + 5.0
        return client.decisions

    client.until(begins)
    first = client.decisions[0]
    assert first['step'] == '0'
    assert int(first['stamp']) in newest


def test_without_a_listener_of_its_type_the_time_does_not_run(fault, start_node, make_client):
    client = make_client(kind=TwistStamped)
    guidance = start_node()
    client.until(client.odometry.get_subscription_count)
    client.drive()
    health = client.until_health(state='active', said='enable_stamped_cmd_vel')
    assert health['level'] == DiagnosticStatus.WARN
    assert health['said'] == (
        'Waiting for a listener to /cmd_vel (geometry_msgs/msg/Twist).'
        ' Another listener wants geometry_msgs/msg/TwistStamped: enable_stamped_cmd_vel.'
    )
    fault.assert_told(health)
    client.until(lambda: guidance.stderr.count(health['said']) == 1)
    assert not client.decisions
    client.park()
    driver = start_node('sim_node')
    client.until(lambda: client.decisions)
    assert client.decisions[0]['step'] == '0'
    assert float(client.decisions[0]['time_left']) > 9.5
    driver.end()
    client.until_health(state='active', said='Nobody listens to /cmd_vel.')


def test_a_recorder_that_is_asked_for_is_waited_for(start_node, client, record):
    running = start_node('guidance_node', {'recorder_timeout': 60.0})
    client.until(client.odometry.get_subscription_count)
    client.drive()
    client.until_health(state='active', said='Waiting for a recorder (recorder_timeout).')
    assert not client.decisions
    recording = record('own_topics:=true')
    client.until(lambda: len(client.decisions) > 5)
    running.end()
    outcome = recording.replayed()
    assert outcome.skipped == 0
    assert outcome.decisions >= 5


def test_a_recorder_is_waited_for_until_it_hears_what_is_seen(ros, start_node, client):
    start_node('guidance_node', {'recorder_timeout': 60.0, 'sensors.names': '[front]'})
    recorder = Node('recorder', context=ros.node.context)
    try:
        recorder.create_subscription(Odometry, 'odom', print, 10)
        for topic in (COMMAND, DECISION, WHEELS):
            name = topic.name.replace('~', '/guidance')
            recorder.create_subscription(topic.type, name, print, topic.qos)
        counted = [f'{each}_subscribers' for each in ('command', 'decision', 'wheel')]
        client.until(lambda: all(int(client.latest(each, '0')) > 1 for each in counted))
        before = len(client.health)
        client.until(lambda: len(client.health) > before + 2)
        client.until_health(said='Waiting for a recorder', sighting_subscribers='0')
        for topic in (SIGHTING, OWN_TRACKS):
            name = topic.name.replace('~', '/guidance')
            recorder.create_subscription(topic.type, name, print, topic.qos)
        told = {'sighting_subscribers': '1', 'tracks_subscribers': '1'}
        client.until_health(said='Waiting for odometry', **told)
    finally:
        recorder.destroy_node()


def test_where_no_recorder_comes_it_goes_on_without(fault, start_driving, client):
    running = start_driving({'recorder_timeout': 0.5})
    (said,) = [line for line in running.stderr.splitlines() if 'no recorder' in line]
    assert '[WARN]' in said
    fault.assert_said('—', 1, said.partition('[guidance]: ')[2])


def test_who_comes_late_is_told_the_latest_decision(start_active, client, make_odometry):
    start_active({'odom_timeout': 60.0})
    decision, _ = client.decide(make_odometry(client.now(), (0.0, -9.25, 0.0)))
    found, latched = [], QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    client.node.create_subscription(DECISION.type, '/guidance/decision', found.append, latched)
    client.until(lambda: found)
    values = {each.key: each.value for each in found[-1].status[0].values}
    assert values['stamp'] == decision['stamp']


def test_it_beats_while_the_node_is_active(interfaces, start_node, client):
    interfaces('bond')
    from bond.msg import Status

    beats = []
    client.node.create_subscription(Status, 'bond', beats.append, 100)
    running = start_node(parameters={'autostart': False})
    assert client.change_state('configure')
    client.until(lambda: client.node.count_publishers('bond'))
    assert client.change_state('activate')
    client.until(lambda: len(beats) > 3)
    assert {(each.id, each.active) for each in beats} == {('guidance', True)}
    assert client.change_state('deactivate')
    client.until(lambda: not beats[-1].active)
    first = beats[-1].instance_id
    assert client.change_state('activate')
    client.until(lambda: beats[-1].active)
    assert beats[-1].instance_id != first
    running.end()
    client.until(lambda: not beats[-1].active)
