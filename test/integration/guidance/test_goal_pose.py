"""Goals that are told to the guidance node as RViz tells them."""

import numpy as np
from geometry_msgs.msg import PoseStamped
from live import LATCHED, PERIOD_NS, pose_stamped
from visualization_msgs.msg import MarkerArray

from cmpsp_ros.guidance import GuidanceLaw, Observation
from cmpsp_ros.guidance.messages import OdometryReading, goal_of
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file

# Odometry is stamped ahead of time here, and the test may be slow between two messages.
PATIENT = {'odom_timeout': 60.0}


def assert_logged(fault, running, words):
    """The warning with these words is as its row of doc/reference/faults.md says."""
    (line,) = (each for each in running.stderr.splitlines() if words in each)
    assert '[WARN]' in line
    sentence = line.partition('[guidance]: ')[2].removeprefix('goal_pose is refused: ')
    fault.assert_said('—', 1, sentence)


def test_a_goal_is_driven_to_and_one_in_another_frame_refused(
    fault, start_node, client, make_odometry
):
    values = TABLE.resolve({**load_parameter_file('case3'), **PATIENT})
    settings = guidance_settings(values)
    law, shown = GuidanceLaw(settings, settings.world), []
    running = start_node('guidance_node', PATIENT)
    client.node.create_subscription(MarkerArray, '/guidance/markers', shown.append, LATCHED)
    goals = client.node.create_publisher(PoseStamped, 'goal_pose', 10)
    client.until(goals.get_subscription_count)
    client.until_health(state='active')
    client.connect()
    pose, stamp = np.array([0.0, -9.25, 0.0]), client.now()

    def step():
        nonlocal pose, stamp
        message = make_odometry(stamp, pose)
        heard, _ = client.decide(message)
        decision = law.step(Observation(stamp, OdometryReading.of(message).pose_in('odom')))
        pose, stamp = decision.plan.poses[1], stamp + PERIOD_NS
        return heard, decision

    heard, _ = step()
    assert 'goal' not in heard
    goals.publish(pose_stamped(0, 'map', (7.0, -7.0, 0.8)))
    client.until(lambda: "in frame 'map', wanted 'odom'" in running.stderr)
    assert_logged(fault, running, 'goal_pose is refused')
    wanted = pose_stamped(0, 'odom', (7.0, -7.0, 0.8))
    goals.publish(wanted)
    # What is published first may still be heard last: a step or two are taken meanwhile.
    for _ in range(20):
        before = law.task
        heard, _ = step()
        if 'goals_received' in heard:
            break
    assert heard['goals_received'] == '1'
    assert heard['goal'] == 'goal_pose'
    assert [float(heard[key]) for key in ('goal_x', 'goal_y')] == [7.0, -7.0]
    assert float(heard['goal_heading']) == goal_of(wanted, 'odom')[1].heading
    assert before.goal == (10.0, 0.0)

    def is_shown():
        discs = [each for each in shown[-1].markers if each.ns == 'goal'] if shown else []
        return [(each.pose.position.x, each.pose.position.y) for each in discs] == [(7.0, -7.0)]

    client.until(is_shown)
    assert client.change_state('deactivate')
    goals.publish(wanted)
    client.until(lambda: 'goal_pose is not heard' in running.stderr)
    assert_logged(fault, running, 'goal_pose is not heard')
