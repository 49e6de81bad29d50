"""The plan in the colours of level and clearance, the reason at the robot, moving obstacles."""

import numpy as np
import pytest
from visualization_msgs.msg import Marker

from cmpsp_ros.guidance import FallbackLevel, GuidanceLaw, Observation
from cmpsp_ros.guidance.messages import Track
from cmpsp_ros.guidance.safety import plan_clearance
from cmpsp_ros.nodes.guidance.outputs.markers import FAR, NEAR, PLENTY, PlanMarkers, color_of
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file


def settings_of(preset='case3', **changes):
    return guidance_settings(TABLE.resolve({**load_parameter_file(preset), **changes}))


@pytest.fixture(scope='module')
def settings():
    return settings_of(frame_id='map')


@pytest.fixture(scope='module')
def law(settings):
    return GuidanceLaw(settings, settings.world)


@pytest.fixture(scope='module')
def decision(law):
    """The first of case 3."""
    return law.step(Observation(3_000_000_005, np.array([0.0, -9.25, 0.0])))


@pytest.fixture
def fill(settings):
    """Fill the message; band, line and sentence, and what moves."""
    message = PlanMarkers(settings)
    return lambda decision: message.fill(decision).markers


def test_the_plan_is_drawn_from_the_robot_to_the_goal(fill, decision):
    plan, line, text = fill(decision)
    assert [plan.action, line.action, text.action] == [Marker.ADD] * 3
    assert len(plan.points) == 51
    assert line.points == plan.points
    assert line.scale.x < plan.scale.x
    assert line.pose.position.z > plan.pose.position.z
    assert (plan.points[0].x, plan.points[0].y) == (0.0, -9.25)
    assert (plan.points[-1].x, plan.points[-1].y) == pytest.approx((10.0, 0.0), abs=1.0)
    assert (text.pose.position.x, text.pose.position.y) == (0.0, -9.25)
    assert text.text == f'{decision.level.name.lower()}: {decision.reason}'


def test_every_level_has_its_colour(fill, decision):
    def color(**changes):
        plan, _, text = fill(decision._replace(**changes))
        assert plan.color == text.color
        assert plan.color.a == 1.0
        return plan.color.r, plan.color.g, plan.color.b

    colors = {level: color(level=level) for level in FallbackLevel}
    assert len(set(colors.values())) == len(FallbackLevel)
    assert colors[FallbackLevel.NOMINAL] == pytest.approx((0.0, 158 / 255, 115 / 255))
    # Having arrived is no stop that should worry anybody.
    assert color(level=FallbackLevel.STOP, finished=True) != colors[FallbackLevel.STOP]


def rgb(color):
    return color.r, color.g, color.b


def test_the_line_goes_from_red_at_the_margin_to_green(fill, decision):
    # Case 3 begins in the middle of its road, passes two obstacles and ends amid the road again.
    _, line, _ = fill(decision)
    assert len(line.colors) == len(line.points)
    assert {each.a for each in line.colors} == {1.0}
    spare = np.linspace(0.0, PLENTY, 9)
    greens = [color_of(each).g for each in spare[:5]]
    reds = [color_of(each).r for each in spare[4:]]
    assert greens == sorted(greens)
    assert reds == sorted(reds, reverse=True)
    assert (color_of(-1.0), color_of(0.0)) == (NEAR, NEAR)
    assert (color_of(PLENTY), color_of(9.0)) == (FAR, FAR)


def test_each_stage_has_the_colour_of_its_own_clearance(decision):
    settings = settings_of(**{'safety.margin': 0.05})
    law = GuidanceLaw(settings, settings.world)
    made = law.step(Observation(0, np.array([0.0, -9.25, 0.0])))
    room = plan_clearance(settings, settings.world, made)
    _, line, _ = PlanMarkers(settings).fill(made).markers
    assert line.colors == [color_of(each - 0.05) for each in room.tolist()]
    assert len(set(map(rgb, line.colors))) > 5


def test_without_a_plan_the_line_goes_and_the_sentence_stays(law, decision, settings):
    message = PlanMarkers(settings)
    halted = law.halt(4_000_000_000, 'No odometry.')
    assert [each.action for each in message.fill(halted).markers] == [Marker.DELETE] * 3
    before = [(each.ns, each.id) for each in message.fill(decision).markers]
    plan, line, text = message.fill(halted).markers
    assert [(each.ns, each.id) for each in (plan, line, text)] == before
    assert [plan.action, line.action, text.action] == [Marker.DELETE, Marker.DELETE, Marker.ADD]
    assert (plan.points, line.points, line.colors) == ([], [], [])
    assert text.text == 'stop: No odometry.'
    assert (text.pose.position.x, text.pose.position.y) == (0.0, -9.25)


def test_what_moves_is_where_it_is_by_now_with_an_arrow_a_second_long(decision):
    settings = settings_of(
        frame_id='map',
        **{'robot.radius': 0.1, 'safety.margin': 0.05, 'moving_obstacles.growth': 0.2},
    )
    seen = Track(7, decision.stamp - 500_000_000, 0.3, 5.0, -9.0, -0.5, 0.25)
    message = PlanMarkers(settings)
    markers = message.fill(decision._replace(tracks=(seen,))).markers
    disc, arrow, now, later = markers[3:]
    assert [(each.ns, each.id) for each in (disc, arrow, now, later)] == [
        ('moving_obstacles', 7), ('moving_velocities', 7), ('moving_margins', 7),
        ('moving_foreseen', 7),
    ]  # fmt: skip
    assert (disc.pose.position.x, disc.pose.position.y) == (4.75, -8.875)
    assert (disc.scale.x, disc.scale.y) == pytest.approx((0.6, 0.6), abs=1e-3)
    assert [(each.x, each.y) for each in arrow.points] == [(4.75, -8.875), (4.25, -8.625)]
    # Its radius, half a second's growth or one and a half's, the robot's radius and the margin.
    for kept, center, radius in ((now, (4.75, -8.875), 0.55), (later, (4.25, -8.625), 0.75)):
        assert (kept.pose.position.x, kept.pose.position.y) == center
        assert (kept.scale.x, kept.scale.y) == pytest.approx((2.0 * radius, 2.0 * radius), abs=1e-3)
    for each in markers:
        assert each.header.frame_id == 'map'
        assert each.lifetime.sec + each.lifetime.nanosec > 0
    assert len(message.fill(decision).markers) == 3


def test_a_track_in_doubt_has_discs_that_it_may_fill(decision):
    seen = Track(7, decision.stamp - 500_000_000, 0.3, 5.0, -9.0, -0.5, 0.25, 0.1, 0.2)
    markers = PlanMarkers(settings_of()).fill(decision._replace(tracks=(seen,))).markers
    shown = {each.ns: each for each in markers}
    for namespace, radius in (('moving_doubts', 0.7), ('moving_doubts_foreseen', 1.1)):
        assert shown[namespace].scale.x == pytest.approx(2.0 * radius, abs=1e-3), (
            'two sigma after 0.5 or 1.5 s'
        )
        assert shown[namespace].color.a < 0.5
    later = shown['moving_doubts_foreseen'].pose.position
    assert (later.x, later.y) == (4.25, -8.625)
    wider = settings_of(**{'people.quantile': 3.0, 'moving_obstacles.growth': 0.0})
    markers = PlanMarkers(wider).fill(decision._replace(tracks=(seen,))).markers
    (disc,) = (each for each in markers if each.ns == 'moving_margins')
    kept = 0.3 + 3.0 * 0.2 + wider.robot_radius + wider.safety.margin
    assert disc.scale.x == pytest.approx(2.0 * kept, abs=1e-3)


def test_what_moves_reddens_the_stages_that_it_comes_near(fill, decision):
    _, before, _ = fill(decision)
    x, y = decision.plan.poses[25, :2].tolist()
    standing = Track(7, decision.stamp, 0.0, x, y, 0.0, 0.0)
    _, line, *_ = fill(decision._replace(tracks=(standing,)))
    assert line.colors[25] == NEAR
    assert line.colors[:15] == before.colors[:15]


def test_a_robot_with_corners_is_drawn_where_the_plan_begins():
    given = settings_of('slot')
    decision = GuidanceLaw(given, given.world).step(Observation(0, np.array([0.0, -0.3, 0.5])))
    (outline,) = [
        each for each in PlanMarkers(given).fill(decision).markers if each.ns == 'footprint'
    ]
    corners = [(point.x, point.y) for point in outline.points]
    np.testing.assert_allclose(corners[:-1], given.footprint.at(decision.plan.poses[0]))
    assert corners[0] == corners[-1]
    assert outline.action == Marker.ADD
    assert outline.color == PlanMarkers(given).fill(decision).markers[0].color
