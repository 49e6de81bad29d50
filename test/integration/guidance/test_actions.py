"""Goals as Nav2's actions: a real client, guidance node and simulator, in real time."""

import math
import sys

import pytest
from action_msgs.msg import GoalStatus
from commands import command
from geometry_msgs.msg import PoseStamped
from live import CASE3, UNKNOWN
from nav_msgs.msg import Odometry
from rclpy.action import ActionClient

from cmpsp_ros.nodes import MODULES
from cmpsp_ros.nodes.common.messages import path_of

pytestmark = pytest.mark.timeout(300)


class Goal:
    """A goal that is sent, and what comes of it."""

    def __init__(self, client, actions, request):
        self.client, self.feedback = client, []
        sent = actions.send_goal_async(request, lambda each: self.feedback.append(each.feedback))
        client.until(sent.done)
        self.handle = sent.result()
        self.ended = self.handle.get_result_async() if self.handle.accepted else None

    def result(self):
        self.client.until(self.ended.done)
        answer = self.ended.result()
        return answer.status, answer.result.error_code, answer.result.error_msg

    def cancel(self):
        answer = self.handle.cancel_goal_async()
        self.client.until(answer.done)
        return len(answer.result().goals_canceling)


@pytest.fixture
def actions(interfaces, client):
    """Send a goal to an action: `actions('NavigateToPose', 'navigate_to_pose', **request)`."""
    interfaces('nav2_msgs')
    import nav2_msgs.action

    clients = {}

    def send(kind, name, **request):
        action = getattr(nav2_msgs.action, kind)
        if name not in clients:
            clients[name] = ActionClient(client.node, action, name)
            client.until(clients[name].server_is_ready)
        return Goal(client, clients[name], action.Goal(**request))

    yield send
    for each in clients.values():
        each.destroy()


@pytest.fixture
def drive(spawn, client):
    """A simulator, recorded first, and a guidance node that is active: `drive(parameters)`."""

    def start(parameters, files=(CASE3,), *, recorded=True):
        flags = [part for each in files for part in ('--params-file', each)]
        given = [part for key, value in parameters.items() for part in ('-p', f'{key}:={value}')]
        spawn([sys.executable, '-m', MODULES['sim_node'], '--ros-args', *flags, *given])
        # Else the recorder may miss the odometry of the first decision.
        client.until(lambda: not recorded or '/odom messages' in client.recorded)
        command = [sys.executable, '-m', MODULES['guidance_node'], '--ros-args', *flags, *given]
        guidance = spawn([*command, '-p', 'autostart:=true'])
        client.until_health(state='active')
        client.poses = []
        client.node.create_subscription(Odometry, '/odom', client.poses.append, 100)
        client.until(lambda: client.poses)
        return guidance

    return start


def place(x, y, frame_id='odom'):
    pose = PoseStamped()
    pose.header.frame_id = frame_id
    pose.pose.position.x, pose.pose.position.y, pose.pose.orientation.w = x, y, 0.0
    return pose


def distance(client, x, y):
    position = client.poses[-1].pose.pose.position
    return math.dist((position.x, position.y), (x, y))


def test_navigate_to_pose(drive, actions, client, record):
    recording = record()
    guidance = drive({'recorder_timeout': 30.0, 'goal.wait': 'true'})
    client.until(lambda: len(client.decisions) > 3)
    assert {each['reason'] for each in client.decisions} == {'No goal has come yet (goal.wait).'}
    assert set(client.commands) == {(0.0, 0.0)}

    def navigate(x, y, frame_id='odom'):
        pose = place(x, y, frame_id)
        return actions('NavigateToPose', 'navigate_to_pose', pose=pose)

    goal = navigate(5.0, -8.3)
    assert goal.result() == (GoalStatus.STATUS_SUCCEEDED, 0, '')
    assert distance(client, 5.0, -8.3) < 0.05
    left = [each.distance_remaining for each in goal.feedback]
    assert left[0] > 1.0
    assert left[-1] < 0.5
    assert goal.feedback[0].estimated_time_remaining.sec > goal.feedback[-1].navigation_time.sec - 9
    assert goal.feedback[0].current_pose.header.frame_id == 'odom'

    # One that is refused leaves the robot where it is, and one in an unknown frame too.
    status, code, reason = navigate(0.0, 0.0).result()
    assert (status, code) == (GoalStatus.STATUS_ABORTED, 103)
    assert 'The goal is 9 m inside or beyond' in reason
    status, code, reason = navigate(0.0, 0.0, 'map').result()
    assert (status, code) == (GoalStatus.STATUS_ABORTED, 102)
    assert "frame 'map', wanted 'odom'" in reason

    # Cancelled half way it stops, and stays.
    goal = navigate(9.3, 4.0)
    client.until(lambda: len(goal.feedback) > 8)
    assert client.commands[-1][0] > 0.5
    assert goal.cancel() == 1
    assert goal.result() == (GoalStatus.STATUS_CANCELED, 0, 'The goal was cancelled.')
    assert client.commands[-1] == (0.0, 0.0)
    count = len(client.decisions)
    client.until(lambda: len(client.decisions) > count + 3)
    assert {each['cancelled'] for each in client.decisions[count:]} == {'true'}
    assert distance(client, 9.3, 4.0) > 1.0

    # Another client's goal takes the place of the first one's, and the topic's that of both.
    first = navigate(9.3, 4.0)
    client.until(lambda: first.feedback)
    second = navigate(9.0, 4.5)
    assert first.result()[::2] == (GoalStatus.STATUS_ABORTED, 'Another goal came.')
    client.until(lambda: second.feedback)
    # One that is refused leaves it.
    assert navigate(0.0, 0.0).result()[0] == GoalStatus.STATUS_ABORTED
    client.teller(PoseStamped, 'goal_pose')(place(8.5, 5.2))
    assert second.result()[2] == 'Another goal came on goal_pose.'

    last = navigate(9.0, 4.5)
    client.until(lambda: last.feedback)
    assert client.change_state('deactivate')
    reason = 'The guidance node was deactivated.'
    assert last.result() == (GoalStatus.STATUS_ABORTED, 100, reason)
    assert not navigate(9.0, 4.5).handle.accepted
    client.until(lambda: 'navigate_to_pose is rejected: the node is inactive' in guidance.stderr)
    assert 'Traceback' not in guidance.stderr
    guidance.end()
    outcome = recording.replayed()
    assert outcome.decisions >= len(client.decisions)


def test_a_goal_that_is_cancelled_while_odometry_is_lost_ends(
    actions, start_active, client, make_odometry
):
    start_active({'odom_timeout': 0.5})
    client.decide(make_odometry(client.now(), (0.0, -9.25, 0.0)))
    goal = actions('NavigateToPose', 'navigate_to_pose', pose=place(9.3, 4.0))
    lost = 'No usable odometry for more than 0.5 s (odom_timeout).'
    client.until(lambda: client.decisions[-1]['reason'] == lost)
    assert goal.cancel() == 1
    assert goal.result() == (GoalStatus.STATUS_CANCELED, 0, lost)


CORRIDOR = {
    'road.type': 'corridor', 'road.half_width': '[0.6]', 'initial_pose': '[0.,0.,0.]',
    'road.points': '[0.0,0.0,5.0,0.0]', 'road.source': 'topic', 'goal.position': '[5.,0.]',
    'recorder_timeout': 30.0,
}  # fmt: skip


def test_follow_path(drive, actions, client, record):
    recording = record()
    guidance = drive(CORRIDOR, files=())

    def follow(points, **more):
        numbers = [number for point in points for number in point]
        given = {'road.points': numbers, 'road.closed': False, 'frame_id': 'odom', **more}
        return actions('FollowPath', 'follow_path', path=path_of(given))

    path = [(-0.5, 0.0), (2.0, 0.0), (4.0, 1.0), (5.0, 3.0)]
    goal = follow(path)
    assert goal.result() == (GoalStatus.STATUS_SUCCEEDED, 0, '')
    assert distance(client, 5.0, 3.0) < 0.05
    assert max(each.speed for each in goal.feedback) > 0.5
    assert goal.feedback[0].distance_to_goal > goal.feedback[-1].distance_to_goal
    status, code, reason = follow([(5.0, 3.0), (7.0, 3.0), (6.0, 3.0)]).result()
    assert (status, code) == (GoalStatus.STATUS_ABORTED, 103)
    assert 'a turn back by 180 deg' in reason
    assert follow(path, frame_id='map').result()[1] == 102
    guidance.end()
    outcome = recording.replayed()
    assert outcome.decisions > 20


def test_follow_path_as_soon_as_possible(drive, actions, client, record):
    recording = record()
    limits = {'robot.max_wheel_acceleration': 60.0, 'robot.max_lateral_acceleration': 0.5}
    # With a nominal speed of 0.5 m/s the path of 6.5 m would take 13 s.
    soonest = {'goal.when': 'soonest', 'goal.nominal_speed': 0.5}
    guidance = drive({**CORRIDOR, **limits, **soonest}, files=())
    points = [-0.5, 0.0, 2.0, 0.0, 4.0, 1.0, 5.0, 3.0]
    path = path_of({'road.points': points, 'road.closed': False, 'frame_id': 'odom'})
    goal = actions('FollowPath', 'follow_path', path=path)
    assert goal.result() == (GoalStatus.STATUS_SUCCEEDED, 0, '')
    assert distance(client, 5.0, 3.0) < 0.05
    assert max(each.speed for each in goal.feedback) > 1.0
    across = [abs(speed * turn_rate) for speed, turn_rate in client.commands]
    assert 0.4 < max(across) <= 0.5 * (1.0 + 1e-9)
    guidance.end()
    outcome = recording.replayed()
    assert outcome.decisions > 20


def test_navigate_as_soon_as_possible(drive, actions, client, record):
    recording = record()
    given = {'goal.wait': 'true', 'goal.when': 'soonest', 'goal.nominal_speed': 0.8}
    guidance = drive({'recorder_timeout': 30.0, 'robot.max_wheel_acceleration': 60.0, **given})
    client.until(lambda: client.decisions)
    goal = actions('NavigateToPose', 'navigate_to_pose', pose=place(5.0, -8.3))
    assert goal.result() == (GoalStatus.STATUS_SUCCEEDED, 0, '')
    assert distance(client, 5.0, -8.3) < 0.05
    # At that speed it would be more than 6 s.
    assert goal.feedback[0].estimated_time_remaining.sec < 5
    guidance.end()
    outcome = recording.replayed()
    assert outcome.decisions >= len(client.decisions)


def test_a_goal_inside_a_crate_that_the_scanner_sees_is_aborted_with_the_reason(
    drive, actions, client, record
):
    recording = record()
    given = {'road.type': 'none', 'goal.wait': 'true', 'goal.may_be_late': 'true'}
    given |= {'sight.memory': 600.0, 'robot.max_wheel_speed': 28.0, 'recorder_timeout': 30.0}
    guidance = drive(given, (UNKNOWN,))

    goal = actions('NavigateToPose', 'navigate_to_pose', pose=place(2.75, -0.4))
    status, code, reason = goal.result()

    assert (status, code) == (GoalStatus.STATUS_ABORTED, 105)
    assert 'The goal is unreachable: no plan gets past obstacle seen at (' in reason
    guidance.end()
    assert recording.replayed().decisions > 20
    audit = command('audit', recording.bag).output
    assert 'beyond its tolerance. The goal is unreachable: no plan gets past' in audit
    assert 'failed Path: clear of obstacles' not in audit


def test_a_path_that_is_closed_is_aborted_with_the_reason(drive, actions, client):
    road = {'road.type': 'corridor', 'road.half_width': '[0.6]', 'road.source': 'topic'}
    road |= {'road.points': '[0.0,0.0,5.0,0.0]', 'goal.position': '[5.,0.]', 'robot.radius': 0.1}
    crate = {'obstacles.names': '[crate]', 'obstacles.crate.center': '[3.0,0.0]'}
    given = {**road, **crate, 'obstacles.crate.radius': 0.6, 'initial_pose': '[0.,0.,0.]'}
    drive(given, files=(), recorded=False)
    points = {'road.points': [-0.5, 0.0, 2.0, 0.0, 5.0, 0.0], 'road.closed': False}

    goal = actions('FollowPath', 'follow_path', path=path_of({**points, 'frame_id': 'odom'}))
    status, code, reason = goal.result()

    assert (status, code) == (GoalStatus.STATUS_ABORTED, 105)
    assert 'The road is closed at obstacle crate' in reason
