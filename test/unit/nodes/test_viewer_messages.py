"""Messages to what a page draws, whatever is in them."""

import json
import math

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import Point, PoseStamped
from nav_msgs.msg import Odometry, Path
from rclpy.time import Time
from sensor_msgs.msg import JointState
from visualization_msgs.msg import Marker, MarkerArray

from cmpsp_ros.nodes.guidance.outputs.markers import marker_array
from cmpsp_ros.nodes.viewer import course_of, decision_of, place_of, plan_of, speeds_of, step_of
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file
from cmpsp_ros.view import SharedState
from cmpsp_ros.view.server import ClientState


def status(reason='', **values):
    pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
    return DiagnosticArray(status=[DiagnosticStatus(message=reason, values=pairs)])


def test_a_pose_is_read_from_odometry():
    message = Odometry()
    message.pose.pose.position.x, message.pose.pose.position.y = 1.5, -2.0
    message.pose.pose.orientation.z = math.sin(0.4)
    message.pose.pose.orientation.w = math.cos(0.4)
    assert place_of(message) == pytest.approx((1.5, -2.0, 0.8))
    message.pose.pose.position.y = math.inf
    assert place_of(message) is None


def test_a_decision_is_read_number_by_number():
    decision = decision_of(
        status('All is well.', fallback_level='nominal', step='3', time_left='9.4',
               finished='false', wheel_speed_right='45.5', clearance='nan', terminal_error='none'),
    )  # fmt: skip
    assert (decision['reason'], decision['level']) == ('All is well.', 'nominal')
    numbers = [decision[each] for each in ('step', 'time_left', 'wheel_speed_right')]
    assert numbers == [3, 9.4, 45.5]
    assert math.isnan(decision['clearance'])
    assert decision['terminal_error'] is decision['wheel_speed_left'] is None
    assert decision['finished'] is False
    assert decision_of(status())['level'] is None
    assert decision_of(DiagnosticArray())['level'] is None
    assert decision_of(status(fallback_level='stop'))['level'] == 'stop'
    assert decision_of(status(fallback_level='stop', finished='true'))['level'] == 'arrived'
    for unknown in ('missed', 'halted'):
        late = status(fallback_level='stop', finished='true', **{unknown: 'true'})
        assert decision_of(late)['level'] == 'stop'


def test_a_clearance_is_unknown_where_nothing_is_near():
    decision = decision_of(status(clearance='1000000.0', worst_clearance='0.25'))
    assert (decision['clearance'], decision['worst_clearance']) == (None, 0.25)


def test_texts_are_shortened():
    assert len(decision_of(status('x' * 100_000, fallback_level='y' * 100_000))['reason']) == 500


def test_the_course_is_all_that_stands_in_the_markers():
    settings = guidance_settings(TABLE.resolve(load_parameter_file('case3')))
    course = course_of(marker_array(settings, settings.world, Time(nanoseconds=1).to_msg()))
    kinds = [(each['kind'], each['of']) for each in course]
    assert kinds == [
        ('line', 'road'), ('line', 'road'), ('line', 'centre_line'),
        ('disc', 'obstacles'), ('disc', 'obstacles'),
        ('text', 'obstacle_names'), ('text', 'obstacle_names'),
        ('line', 'margins'), ('line', 'margins'), ('disc', 'goal'),
    ]  # fmt: skip
    assert (course[3]['at'], course[3]['size'], course[5]['text']) == ([8.0, -6.0], 1.4, 'a')
    assert math.hypot(*course[1]['points'][50]) == pytest.approx(11.0)


def test_markers_of_anybody_stay_few_and_small():
    line = Marker(type=Marker.LINE_STRIP, points=[Point()] * 5000)
    other = Marker(type=Marker.MESH_RESOURCE)
    gone = Marker(type=Marker.CYLINDER, action=Marker.DELETE)
    course = course_of(MarkerArray(markers=[other, gone, *[line] * 600]))
    assert len(course) == 498
    assert {len(each['points']) for each in course} == {2000}


def test_a_plan_is_its_points():
    message = Path(poses=[PoseStamped() for _ in range(3)])
    for number, each in enumerate(message.poses):
        each.pose.position.x, each.pose.position.y = 0.5 * number, -1.0
    assert plan_of(message) == [[0.0, -1.0], [0.5, -1.0], [1.0, -1.0]]
    assert plan_of(Path()) == []


def test_speeds_are_those_of_all_wheels():
    assert speeds_of(JointState(velocity=[1.0, 2.0, 3.0])) == [1.0, 2.0, 3.0]
    assert speeds_of(JointState()) == []


def test_everything_read_can_be_shown():
    state = SharedState([])
    state.show('driven', speeds_of(JointState(velocity=[math.nan, 2.0])))
    state.show('decision', decision_of(status(clearance='nan', terminal_error='inf')))
    updates = json.loads(json.dumps(state.updates(ClientState()), allow_nan=False))
    assert updates['driven'] == [None, 2.0]
    assert updates['decision']['terminal_error'] is None


def test_the_step_of_a_car_has_its_steering_angle_beside_the_speed_of_its_wheels():
    given = {'clearance': '0.5', 'fallback_level': 'nominal'}
    car = decision_of(status(wheel_speeds='0.3', steering_angle='-0.2', **given))
    assert step_of(car | {'time': 9.4}) == [9.4, 0.3, -0.2, 0.5, 'nominal']
    other = decision_of(status(wheel_speed_right='2.0', wheel_speed_left='3.0', **given))
    assert step_of(other | {'time': 9.4}) == [9.4, 2.0, 3.0, 0.5, 'nominal']
