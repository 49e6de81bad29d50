"""The plan in the colour of its rung, and the sentence beside the robot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from visualization_msgs.msg import Marker

from cmpsp_ros.guidance.decision import Rung
from cmpsp_ros.guidance.law import GuidanceLaw
from cmpsp_ros.guidance.tracks import Track
from cmpsp_ros.nodes.plan_markers import PlanMarkers
from cmpsp_ros.parameters.catalogue import TABLE
from cmpsp_ros.parameters.presets import load_parameter_file
from cmpsp_ros.parameters.settings import guidance_settings


@pytest.fixture(scope='module')
def law():
    return GuidanceLaw(guidance_settings(TABLE.resolve(load_parameter_file('case3'))))


@pytest.fixture(scope='module')
def decision(law):
    """The first of case 3."""
    return law.update(3_000_000_005, np.array([0.0, -9.25, 0.0]))


@pytest.fixture
def fill():
    """Fill the message; the two markers."""
    message = PlanMarkers('map', 0.2)
    return lambda decision: message.fill(decision).markers


def test_the_plan_is_drawn_from_the_robot_to_the_goal(fill, decision):
    plan, rung = fill(decision)
    assert [plan.action, rung.action] == [Marker.ADD] * 2
    assert len(plan.points) == 51
    assert (plan.points[0].x, plan.points[0].y) == (0.0, -9.25)
    assert (plan.points[-1].x, plan.points[-1].y) == pytest.approx((10.0, 0.0), abs=1.0)
    assert (rung.pose.position.x, rung.pose.position.y) == (0.0, -9.25)
    assert rung.text == f'{decision.rung.name.lower()}: {decision.reason}'


def test_they_are_where_and_when_the_decision_is_and_vanish_by_themselves(fill, decision):
    for each in fill(decision):
        assert each.header.frame_id == 'map'
        assert (each.header.stamp.sec, each.header.stamp.nanosec) == (3, 5)
        assert each.lifetime.sec == 1
        assert each.pose.orientation.w == 1.0
        assert max(each.scale.x, each.scale.z) > 0.0


def test_every_rung_has_its_colour(fill, decision):
    def color(**changes):
        plan, rung = fill(replace(decision, **changes))
        assert plan.color == rung.color
        assert plan.color.a == 1.0
        return plan.color.r, plan.color.g, plan.color.b

    colors = {rung: color(rung=rung) for rung in Rung}
    assert len(set(colors.values())) == len(Rung)
    assert colors[Rung.NOMINAL] == pytest.approx((0.0, 158 / 255, 115 / 255))
    # Having arrived is no stop that should worry anybody.
    assert color(rung=Rung.STOP, finished=True) != colors[Rung.STOP]


def test_without_a_plan_the_line_goes_and_the_sentence_stays(law, decision):
    message = PlanMarkers('odom', 0.2)
    halted = law.halt(4_000_000_000, 'No odometry.')
    plan, rung = message.fill(halted).markers
    assert [plan.action, rung.action] == [Marker.DELETE] * 2
    before = [(each.ns, each.id) for each in message.fill(decision).markers]
    plan, rung = message.fill(halted).markers
    assert [(each.ns, each.id) for each in (plan, rung)] == before
    assert [plan.action, rung.action] == [Marker.DELETE, Marker.ADD]
    assert plan.points == []
    assert rung.text == 'stop: No odometry.'
    assert (rung.pose.position.x, rung.pose.position.y) == (0.0, -9.25)


def test_what_moves_is_where_it_is_by_now_with_an_arrow_a_second_long(fill, decision):
    seen = Track(7, decision.stamp - 500_000_000, 0.3, 5.0, -9.0, -0.5, 0.25)
    markers = fill(replace(decision, tracks=(seen,)))
    disc, arrow = markers[2:]
    assert (disc.ns, disc.id, arrow.ns, arrow.id) == (
        'moving_obstacles', 7, 'moving_velocities', 7,
    )  # fmt: skip
    assert (disc.pose.position.x, disc.pose.position.y) == (4.75, -8.875)
    assert (disc.scale.x, disc.scale.y) == (0.6, 0.6)
    assert [(each.x, each.y) for each in arrow.points] == [(4.75, -8.875), (4.25, -8.625)]
    for each in markers:
        assert each.header.frame_id == 'map'
        assert each.lifetime.sec + each.lifetime.nanosec > 0
    assert len(fill(decision)) == 2
