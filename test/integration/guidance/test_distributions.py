"""Messages of Nav2 as each distribution of ROS defines them."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from interface_packages import DEFINITIONS, LYRICAL, build

ROOT = Path(__file__).parents[3]

# Fields are checked, and the whole is serialized.
PROGRAM = """
from geometry_msgs.msg import PoseStamped
from nav2_msgs.action import FollowPath, NavigateToPose
from rclpy.serialization import serialize_message
from cmpsp_ros.nodes.guidance.inputs import goals
pose = PoseStamped()
pose.pose.position.x = 3.0
feedback = goals.path_feedback(pose, 1.5, 0.25)
values = getattr(feedback, 'tracking_feedback', feedback)
found = [values.distance_to_goal, values.speed]
if values is not feedback:
    found += [values.robot_pose.pose.position.x, values.remaining_path_length]
for kind in (FollowPath, NavigateToPose):
    result = goals.result(kind, 103, 'why')
    found += [result.error_code, result.error_msg]
    serialize_message(result)
serialize_message(feedback)
print(found)
"""


@pytest.mark.timeout(600)
@pytest.mark.parametrize(
    ('definitions', 'feedback'),
    [(DEFINITIONS, [1.5, 0.25]), (LYRICAL, [1.5, 0.25, 3.0, 1.5])],
    ids=['jazzy and kilted', 'lyrical'],
)
def test_answers_of_actions(definitions, feedback, tmp_path):
    folder = build('nav2_msgs', tmp_path, definitions)
    path = os.pathsep.join([str(folder), str(ROOT)])
    environment = {**os.environ, 'PYTHONPATH': path, 'ROS_PYTHON_CHECK_FIELDS': '1'}
    command = [sys.executable, '-c', PROGRAM]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.stderr == ''
    assert done.stdout == f'{[*feedback, 103, "why", 103, "why"]}\n'
