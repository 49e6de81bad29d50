"""The guidance node as a process: states, one control step, parameters."""

import signal

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PolygonStamped, TwistStamped
from live import LATCHED, MS, PERIOD_NS
from rclpy.time import Time
from visualization_msgs.msg import Marker, MarkerArray

from cmpsp_ros.guidance import GuidanceLaw, Observation
from cmpsp_ros.guidance.messages import OdometryReading
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file

# Odometry is stamped ahead of time here, and the test may be slow between two messages.
PATIENT = {'odom_timeout': 60.0}


@pytest.fixture
def law():
    """The law itself, with the settings of the node under test."""
    values = TABLE.resolve({**load_parameter_file('case3'), **PATIENT})
    settings = guidance_settings(values)
    return GuidanceLaw(settings, settings.world)


@pytest.mark.smoke
def test_every_state_is_entered_left_and_shown(start_node, client):
    running = start_node('guidance_node', {'autostart': False})
    client.until_health(state='unconfigured', level=DiagnosticStatus.OK)
    assert not client.change_state('activate')
    assert not client.change_state(99)
    for _ in range(2):
        assert client.change_state('configure')
        client.until_health(state='inactive')
        assert client.change_state('activate')
        client.until_health(state='active', level=DiagnosticStatus.WARN, said='Waiting')
        assert not client.change_state('configure')
        client.connect()
        client.drive()
        client.until_driving()
        client.until_health(state='active', fallback_level='nominal', level=DiagnosticStatus.OK)
        assert client.change_state('deactivate')
        client.until(lambda: client.commands[-1] == (0.0, 0.0))
        client.until_health(state='inactive')
        count = len(client.commands)
        client.until(lambda: client.decisions[-1]['reason'].endswith('was deactivated.'))
        # Odometry still comes; nobody must answer it.
        heard = len(client.health)
        client.until(lambda heard=heard: len(client.health) > heard)
        assert len(client.commands) == count
        client.park()
        assert client.change_state('cleanup')
        client.until_health(state='unconfigured')
        client.until(lambda: not client.node.count_publishers('/cmd_vel'))
    assert client.state == 'unconfigured'
    running.signal(signal.SIGINT)
    assert running.wait() == 0
    assert 'Traceback' not in running.stderr


def test_topics_come_and_go_while_odometry_comes(start_node, client):
    """The executor is told of each message, of topics that are closed by then too."""
    running = start_node('guidance_node', {'autostart': False, 'moving_obstacles.capacity': 4})
    client.drive()
    for _ in range(20):
        for change in ('configure', 'activate', 'deactivate', 'cleanup'):
            assert client.change_state(change)
    assert client.state == 'unconfigured'
    running.signal(signal.SIGINT)
    assert running.wait() == 0, running.stderr


@pytest.mark.parametrize('state', ['unconfigured', 'inactive', 'active'])
def test_after_a_shutdown_by_service_a_signal_ends_the_process(start_node, client, state):
    running = start_node('guidance_node', {'autostart': state == 'active'})
    if state == 'inactive':
        assert client.change_state('configure')
    if state == 'active':
        client.connect()
        client.drive()
        client.until_driving()
    client.until_health(state=state)
    assert client.change_state(f'{state}_shutdown')
    if state == 'active':
        client.until(lambda: client.commands[-1] == (0.0, 0.0))
    assert client.state == 'finalized'
    client.until_health(state='finalized')
    running.signal(signal.SIGINT)
    assert running.wait() == 0, running.stderr
    assert 'FATAL' not in running.stderr


def test_one_command_at_each_control_instant_as_the_law_says(
    start_active, client, law, make_odometry
):
    start_active(PATIENT)
    robot, pose, begun = guidance_settings(TABLE.resolve({})).robot, [0.0, -9.25, 0.0], client.now()
    stamps = [begun, begun + 250 * MS, *(begun + k * PERIOD_NS for k in range(2, 6))]
    for step, stamp in enumerate(stamps):
        message = make_odometry(stamp, pose)
        decision, command = client.decide(message)
        wanted = law.step(Observation(stamp, OdometryReading.of(message).pose_in('odom')))
        assert command == tuple(wanted.twist.tolist())
        assert len(client.commands) == len(client.decisions) == step + 1
        assert decision['reason'] == wanted.reason
        assert decision['fallback_level'] == wanted.level.name.lower()
        exact = ('step', 'stamp', 'iterations', 'qp_iterations', 'active_rows', 'failures')
        for key in exact:
            assert int(decision[key]) == getattr(wanted, key)
        for key in ('time_left', 'terminal_error', 'clearance', 'worst_clearance', 'slack'):
            assert float(decision[key]) == getattr(wanted, key)
        assert float(decision['wheel_speed_right']) == wanted.wheel_speeds[0]
        assert float(decision['wheel_speed_left']) == wanted.wheel_speeds[1]
        assert {key for key in decision if key.endswith('_ms')} == {
            'solve_ms',
            'audit_ms',
            'step_ms',
            'odometry_to_command_ms',
        }
        assert decision['finished'] == 'false'

        client.until(lambda step=step: len(client.wheels) == step + 1)
        assert client.wheels[-1].velocity.tolist() == wanted.wheel_speeds.tolist()
        assert client.wheels[-1].name == ['wheel_right_joint', 'wheel_left_joint']
        client.until(lambda step=step: len(client.paths) == step + 1)
        points = [(p.pose.position.x, p.pose.position.y) for p in client.paths[-1].poses]
        assert points == [tuple(point) for point in wanted.plan.poses[:, :2].tolist()]
        miss = np.hypot(points[-1][0] - 10.0, points[-1][1])
        assert miss == pytest.approx(float(decision['terminal_error']))
        times = [Time.from_msg(p.header.stamp).nanoseconds for p in client.paths[-1].poses]
        assert times[0] == stamp
        assert times[-1] == begun + 10_000 * MS

        # Between two control instants nothing is decided: the next answer is to the next one.
        following = stamps[step + 1] if step + 1 < len(stamps) else stamp + PERIOD_NS

        def on_the_way(seconds, pose=pose, wheels=wanted.wheel_speeds):
            return robot.roll_out(np.array(pose), wheels[None], np.array([seconds]))[1].tolist()

        next_due = begun + (1 + (stamp - begun) // PERIOD_NS) * PERIOD_NS
        for between in (stamp, stamp + 20 * MS, next_due - 1):
            client.send(between, on_the_way((between - stamp) / 1e9))
            assert law.step(Observation(between, np.array(pose))) is None
        pose = on_the_way((following - stamp) / 1e9)

    late = []
    client.node.create_subscription(MarkerArray, '/guidance/markers', late.append, LATCHED)
    client.until(lambda: late)
    assert {marker.ns for marker in late[0].markers} > {'road', 'goal', 'obstacles', 'margins'}


def test_the_plan_is_shown_in_the_colour_of_its_fallback_level_and_taken_away_with_it(
    start_node, client
):
    start_node('guidance_node', {'autostart': True, 'odom_timeout': 1.0})
    shown = []
    client.node.create_subscription(MarkerArray, '/guidance/plan_markers', shown.append, 10)
    client.connect()
    client.until(lambda: client.node.count_publishers('/guidance/plan_markers'))
    client.drive()
    client.until(lambda: shown)
    plan, line, text = shown[0].markers
    assert plan.action == line.action == text.action == Marker.ADD
    assert len(plan.points) == len(line.points) == len(line.colors) > 1
    assert text.text.startswith('nominal: ')
    client.park()
    client.until(lambda: shown[-1].markers[2].text.startswith('stop: '))
    assert [each.action for each in shown[-1].markers[:2]] == [Marker.DELETE] * 2


def test_the_corners_of_a_robot_are_where_it_is(start_node, client):
    corners = [[0.1, 0.05], [-0.05, 0.05], [-0.05, -0.05], [0.1, -0.05]]
    parameters = {'autostart': True, 'robot.footprint': f'"{corners}"'}
    start_node('guidance_node', parameters)
    shown = []
    client.node.create_subscription(PolygonStamped, '/guidance/footprint', shown.append, 10)
    client.connect()
    client.until(lambda: client.node.count_publishers('/guidance/footprint'))
    client.drive()
    client.until(lambda: shown)
    points = np.array([(each.x, each.y) for each in shown[0].polygon.points])
    assert shown[0].header.frame_id == 'odom'
    sides = np.hypot(*np.diff(points, axis=0).T)
    np.testing.assert_allclose(sides, [0.15, 0.1, 0.15], atol=1e-5)


def test_a_stamped_command_has_the_stamp_of_its_odometry_and_a_reset_begins_again(
    start_node, make_client, make_odometry
):
    client = make_client(kind=TwistStamped)
    start_node('guidance_node', {**PATIENT, 'enable_stamped_cmd_vel': True})
    client.connect()
    client.until_health(state='active')
    begun, firsts = client.now(), []
    for start in (begun, begun + 1050 * MS):
        for step in range(3):
            stamp = start + step * PERIOD_NS
            decision, command = client.decide(make_odometry(stamp, (0.0, -9.25 + 0.01 * step, 0.0)))
            assert Time.from_msg(client.messages[-1].header.stamp).nanoseconds == stamp
            assert command[0] > 0.5
            assert int(decision['step']) == step
            if step == 0:
                firsts.append(command)
        assert float(decision['time_left']) == 9.6
        assert client.reset().success
        client.until(lambda: client.decisions[-1]['halted'] == 'true')
        client.until(lambda: not any(client.commands[-1]))
    assert firsts[0] == firsts[1]


def test_parameters_change_while_it_drives_as_one_valid_set_or_not_at_all(start_driving, client):
    running = start_driving(PATIENT)
    for key, value, words in (
        ('road.inner_radius', 12.0, ['road.inner_radius', '12.0 m', 'road.outer_radius = 11.0']),
        ('control_period', 0.1, ['control_period', 'read-only']),
        ('goal.position', [0.0, 0.0], ['goal.position', 'inner road edge']),
        ('weights.road_centre', 3.0, []),
    ):
        refused = client.set_parameter(key, value)
        assert not refused.successful
        for each in words:
            assert each in refused.reason
    markers = []
    client.node.create_subscription(MarkerArray, '/guidance/markers', markers.append, LATCHED)
    client.until(lambda: markers)
    assert client.set_parameter('weights.road_center', 0.5).successful
    client.until(lambda: len(markers) > 1)
    client.until_driving()
    client.until_health(state='active', fallback_level='nominal')
    assert client.set_parameter('goal.position', [10.2, 0.0]).successful
    client.until(lambda: abs(client.paths[-1].poses[-1].pose.position.x - 10.2) < 0.1)
    goal = [marker for marker in markers[-1].markers if marker.ns == 'goal']
    client.until(lambda: len(markers) > 2)
    goal = next(marker for marker in markers[-1].markers if marker.ns == 'goal')
    assert goal.pose.position.x == 10.2
    assert all(decision['fallback_level'] == 'nominal' for decision in client.decisions)
    assert 'Traceback' not in running.stderr


@pytest.mark.parametrize(
    ('parameters', 'said'),
    [
        ({'weights.road_centre': 15.0}, ['weights.road_centre:', 'mean weights.road_center?']),
        pytest.param(
            *({'failure_tolerance': 0}, ['failure_tolerance:', 'found 0', '>= 1']),
            marks=pytest.mark.smoke,
        ),
        (
            {'goal.position': '[5.0, 0.0]'},
            ['goal.position:', '4 m inside or beyond the inner road edge'],
        ),
    ],
)
def test_what_it_cannot_be_started_with_is_said_and_nothing_is_commanded(
    fault, start_node, client, parameters, said
):
    running = start_node('guidance_node', parameters)
    health = client.until_health(level=DiagnosticStatus.ERROR)
    for line in health['said'].splitlines():
        fault.assert_said('—', health['level'][0], line)
    for words in said:
        assert words in health['said']
        assert words in running.stderr
    assert health['state'] == 'unconfigured'
    assert client.state == 'unconfigured'
    assert 'Traceback' not in running.stderr

    count = client.node.count_publishers
    assert not count('/cmd_vel')
    assert not count('/guidance/decision')
    assert not client.change_state('configure')
    running.signal(signal.SIGTERM)
    assert running.wait() == 0
