"""Road, obstacles and goal as markers."""

import math
from dataclasses import replace

import pytest
from rclpy.time import Time
from visualization_msgs.msg import Marker

from cmpsp_ros.guidance import Goal
from cmpsp_ros.guidance.formulation import sample_space
from cmpsp_ros.nodes.guidance.outputs.markers import marker_array
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file
from cmpsp_ros.world.obstacles import Capsule, convex

STAMP = Time(nanoseconds=3_000_000_005).to_msg()


def array_of(given, *arguments):
    return marker_array(given, given.world, *arguments)


def settings(preset='case3', **changes):
    return guidance_settings(TABLE.resolve({**load_parameter_file(preset), **changes}))


@pytest.fixture
def markers():
    return array_of(settings(), STAMP).markers


def of(markers, namespace):
    return [each for each in markers if each.ns == namespace]


@pytest.mark.parametrize(
    'changes',
    [
        {},
        {'obstacles.a.center': [8, -6], 'obstacles.a.radius': 1, 'goal.position': [10, 0]},
        {'road.center': [0, 0], 'road.inner_radius': 9, 'road.outer_radius': 11, 'frame_id': 'map'},
    ],
)
def test_every_marker_is_whole_and_replaces_the_old_ones(changes):
    old, *made = array_of(settings(**changes), STAMP).markers
    assert old.action == Marker.DELETEALL
    assert len({(each.ns, each.id) for each in made}) == len(made)
    for each in made:
        assert each.action == Marker.ADD
        assert each.header.frame_id == changes.get('frame_id', 'odom')
        assert each.header.stamp == STAMP
        place, turn, size, color = each.pose.position, each.pose.orientation, each.scale, each.color
        assert turn.w == 1.0
        assert color.a > 0.0
        assert max(size.x, size.y, size.z) > 0.0
        numbers = [place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w]
        numbers += [size.x, size.y, size.z, color.r, color.g, color.b, color.a]
        numbers += [number for point in each.points for number in (point.x, point.y, point.z)]
        assert {type(number) for number in numbers} == {float}
        assert all(math.isfinite(number) for number in numbers)


def test_rings_have_the_radii_of_what_they_show(markers):
    def radii(namespace, center):
        for ring in of(markers, namespace):
            assert ring.type == Marker.LINE_STRIP
            assert ring.points[0].x == pytest.approx(ring.points[-1].x)
            distances = [math.dist((each.x, each.y), center) for each in ring.points]
            assert max(distances) == pytest.approx(min(distances))
            yield distances[0]

    assert list(radii('road', (0.0, 0.0))) == pytest.approx([9.0, 11.0])
    assert list(radii('centre_line', (0.0, 0.0))) == pytest.approx([10.0])
    kept = sample_space(settings(), settings().world).radii
    rings = of(markers, 'margins')
    for ring, radius, center in zip(rings, kept, [(8.0, -6.0), (10.0, -2.0)], strict=True):
        point = ring.points[17]
        assert math.dist((point.x, point.y), center) == pytest.approx(radius)
    assert all(kept > [0.7, 0.5])


def test_discs_and_names_stand_where_the_obstacles_are(markers):
    discs, names = of(markers, 'obstacles'), of(markers, 'obstacle_names')
    assert [each.text for each in names] == ['a', 'b']
    assert [each.scale.x for each in discs] == [1.4, 1.0]
    for marker, center in zip([*discs, *names], [(8.0, -6.0), (10.0, -2.0)] * 2, strict=True):
        assert (marker.pose.position.x, marker.pose.position.y) == center


def test_the_goal_has_its_tolerance_and_can_be_seen():
    (goal,) = of(array_of(settings(), STAMP).markers, 'goal')
    assert (goal.pose.position.x, goal.pose.position.y) == (10.0, 0.0)
    assert goal.scale.x == 0.2
    wide = settings(**{'goal.tolerance': 0.5})
    (goal,) = of(array_of(wide, STAMP).markers, 'goal')
    assert goal.scale.x == 1.0


def test_goals_show_their_headings_and_those_that_are_passed_are_paler():
    course = settings('goals')
    made = array_of(course, STAMP).markers
    goals = of(made, 'goal')
    assert len(goals) == len(course.goals) == 6
    assert len({each.color.a for each in goals}) == 1
    markers = array_of(course, STAMP, replace(course.goals[2], heading=0.5)).markers
    alphas = [each.color.a for each in of(markers, 'goal')]
    assert alphas[0] == alphas[1] < alphas[2] == alphas[5] == goals[0].color.a
    # Only the second has a heading.
    (arrow,), goal = of(made, 'goal_headings'), course.goals[1]
    tail, tip = arrow.points
    assert (tail.x, tail.y) == goal.position
    assert math.atan2(tip.y - tail.y, tip.x - tail.x) == pytest.approx(goal.heading)
    assert of(markers, 'goal_headings') == []


def test_a_goal_that_was_told_is_ahead():
    told = Goal((7.0, -7.0), 12.0, 0.8)
    (goal,) = of(array_of(settings().towards(told), STAMP, told).markers, 'goal')
    assert goal.color.a > 0.5


def test_no_obstacles_no_limit():
    made = array_of(settings('case1'), STAMP).markers
    assert {each.ns for each in made[1:]} == {'road', 'centre_line', 'goal'}


def test_walls_and_polygons_are_drawn_by_their_edges():
    wall = Capsule('wall', (4.0, -9.5), (5.0, -9.5), 0.1)
    crate = convex('crate', [(9.5, -3.0), (10.5, -3.0), (10.5, -2.0), (9.5, -2.0)])
    found = array_of(replace(settings(), obstacles=(wall, crate)), STAMP).markers
    edges, rings = of(found, 'obstacles'), of(found, 'margins')
    assert [each.type for each in (*edges, *rings)] == [Marker.LINE_STRIP] * 4
    assert [(each.x, each.y) for each in edges[1].points] == [*crate.vertices, crate.vertices[0]]
    assert max(each.y for each in edges[0].points) == pytest.approx(-9.4)
    assert max(each.y for each in rings[0].points) > -9.4
    names = of(found, 'obstacle_names')
    assert [(each.pose.position.x, each.pose.position.y) for each in names] == [
        (4.5, -9.5), (10.0, -2.5),
    ]  # fmt: skip


def test_a_map_is_drawn_by_its_outlines_without_a_name():
    made = array_of(settings('door'), STAMP).markers
    walls, margins = of(made, 'obstacles'), of(made, 'margins')
    # The walls of the room, and what it leaves free on either side of the door.
    assert len(walls) == 2
    assert len(margins) >= 2
    assert not of(made, 'obstacle_names')
    for each in (*walls, *margins):
        assert each.type == Marker.LINE_STRIP
        assert each.points[0] == each.points[-1]
    corners = {(round(point.x, 9), round(point.y, 9)) for each in walls for point in each.points}
    assert {(0.0, 0.0), (6.0, 4.0), (2.9, 1.8), (3.0, 2.25)} <= corners
