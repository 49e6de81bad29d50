"""The layouts of RViz and Foxglove show what the nodes publish, in ways that those know."""

import json
import re
from pathlib import Path

import pytest
import yaml
from geometry_msgs.msg import PoseStamped, Twist, TwistStamped
from rclpy.time import Time

from cmpsp_ros.guidance import DECISION_KEYS, GuidanceLaw
from cmpsp_ros.guidance.messages import Track
from cmpsp_ros.nodes.common.topics import GOAL_POSE, TOPICS
from cmpsp_ros.nodes.guidance.outputs.markers import PlanMarkers, marker_array
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file

COMMANDS = (Twist, TwistStamped)
CONFIG = Path(__file__).parents[2] / 'config'

# The types of topics that RViz' displays show (rviz_default_plugins/plugins_description.xml).
DISPLAYS = {
    'rviz_default_plugins/Grid': None,
    'rviz_default_plugins/LaserScan': 'LaserScan',
    'rviz_default_plugins/Map': 'OccupancyGrid',
    'rviz_default_plugins/MarkerArray': 'MarkerArray',
    'rviz_default_plugins/Odometry': 'Odometry',
    'rviz_default_plugins/Path': 'Path',
    'rviz_default_plugins/PointCloud2': 'PointCloud2',
    'rviz_default_plugins/Polygon': 'PolygonStamped',
}
SHOWN = {
    '/guidance/footprint', '/guidance/markers', '/guidance/plan_markers',
    '/guidance/predicted_path', '/guidance/sighting', '/guidance/tracks', '/map', '/odom', '/scan',
}  # fmt: skip
PANELS = {'3D', 'Plot', 'StateTransitions', 'RawMessages', 'DiagnosticSummary', 'Publish'}


@pytest.fixture(scope='module')
def topics():
    """All topics that are published or heard, by name without a namespace."""
    return {
        (name if name[0] == '/' else f'/{name}'): each
        for direction in ('in', 'out')
        for each in reversed(TOPICS)
        if each.direction == direction and (name := each.name.replace('~', f'/{each.node}'))
    }


@pytest.fixture(scope='module')
def rviz():
    return yaml.safe_load((CONFIG / 'cmpsp.rviz').read_text(encoding='utf-8'))


@pytest.fixture(scope='module')
def foxglove():
    return json.loads((CONFIG / 'cmpsp.foxglove.json').read_text(encoding='utf-8'))


def test_every_display_of_rviz_shows_a_topic_of_its_type(rviz, topics):
    shown = set()
    for display in rviz['Visualization Manager']['Displays']:
        assert display['Enabled'] is display['Value']
        wanted = DISPLAYS[display['Class']]
        if wanted is None:
            continue
        topic = topics[display['Topic']['Value']]
        assert topic.type.__name__ == wanted
        shown.add(display['Topic']['Value'])
    assert shown == SHOWN


def test_foxglove_shows_the_same_on_its_course(foxglove):
    assert set(foxglove['configById']['3D!course']['topics']) == SHOWN


def test_rviz_asks_for_no_more_than_the_nodes_offer(rviz, topics):
    for display in rviz['Visualization Manager']['Displays']:
        if 'Topic' in display:
            topic, asked = topics[display['Topic']['Value']], display['Topic']
            latched = asked['Durability Policy'] == 'Transient Local'
            assert latched == topic.latched
            assert asked['Reliability Policy'] == 'Best Effort' or not topic.best_effort


def test_rviz_knows_the_namespaces_of_the_markers_and_the_frame(rviz):
    goals = guidance_settings(TABLE.resolve(load_parameter_file('goals')))
    settings = guidance_settings(TABLE.resolve(load_parameter_file('case3')))
    decision = GuidanceLaw(settings, settings.world).halt(1, 'No odometry.')
    decision = decision._replace(tracks=(Track(7, 1, 0.3, 5.0, -9.0, -0.5, 0.25, 0.1, 0.2),))
    scenery = [
        each
        for course in (settings, goals)
        for each in marker_array(course, course.world, Time(nanoseconds=1).to_msg()).markers
    ]
    listed = {
        display['Topic']['Value']: set(display['Namespaces'])
        for display in rviz['Visualization Manager']['Displays']
        if display['Class'].endswith('MarkerArray')
    }
    for topic, markers in (
        ('/guidance/markers', scenery),
        ('/guidance/plan_markers', PlanMarkers(settings).fill(decision).markers),
    ):
        assert listed[topic] == {each.ns for each in markers if each.ns}
    assert rviz['Visualization Manager']['Global Options']['Fixed Frame'] == settings.frame_id


def leaves(node):
    if isinstance(node, str):
        return [node]
    assert node['direction'] in {'row', 'column'}
    assert 0 < node['splitPercentage'] < 100
    return [*leaves(node['first']), *leaves(node['second'])]


def test_foxglove_shows_each_of_its_panels_once(foxglove):
    shown = leaves(foxglove['layout'])
    assert sorted(shown) == sorted(foxglove['configById'])
    assert {each.partition('!')[0] for each in shown} == PANELS


def paths(foxglove):
    for config in foxglove['configById'].values():
        yield from (each['value'] for each in config.get('paths', ()))
        yield from filter(None, (config.get('topicPath'), config.get('topicToRender')))
        yield from config.get('topics', ())


def test_every_path_of_foxglove_leads_to_a_field_of_a_topic(foxglove, topics):
    for path in paths(foxglove):
        name, *fields = re.sub(r'\[[^]]*\]|\{[^}]*\}', '', path).split('.')
        message = COMMANDS[fields[0] == 'twist']() if name == '/cmd_vel' else topics[name].type()
        for field in fields:
            # A list is empty in a new message; what is in a decision's is read below.
            if isinstance(message, list):
                assert fields == ['status', 'values', 'value']
                break
            message = getattr(message, field)


def test_the_values_that_foxglove_plots_are_those_of_a_decision(foxglove):
    keys = {key for path in paths(foxglove) for key in re.findall(r'key=="(\w+)"', path)}
    assert keys == {'fallback_level', 'worst_clearance', 'terminal_error'}
    assert keys <= DECISION_KEYS.keys()


def test_a_goal_can_be_sent_where_guidance_hears_it(foxglove, rviz):
    panel, scene = (foxglove['configById'][each] for each in ('Publish!goal', '3D!course'))
    tools = rviz['Visualization Manager']['Tools']
    (tool,) = (each for each in tools if each['Class'].endswith('SetGoal'))
    topic = f'/{GOAL_POSE.name}'
    assert {panel['topicName'], scene['publish']['poseTopic'], tool['Topic']['Value']} == {topic}
    assert GOAL_POSE.type is PoseStamped
    assert panel['datatype'] == 'geometry_msgs/PoseStamped'
    goal = json.loads(panel['value'])
    assert {*goal['pose']} <= {*PoseStamped().pose.get_fields_and_field_types()}
    assert goal['header']['frame_id'] == TABLE.resolve({})['frame_id']


def test_foxglove_is_in_the_frame_of_the_course(foxglove):
    assert foxglove['configById']['3D!course']['followTf'] == TABLE.resolve({})['frame_id']
