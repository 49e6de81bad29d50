"""Clearance of a plan, as the check found it, stage by stage."""

import numpy as np
import pytest

from cmpsp_ros.guidance import GuidanceLaw, Observation
from cmpsp_ros.guidance.messages import Track
from cmpsp_ros.guidance.prediction import PlanStart
from cmpsp_ros.guidance.safety import Validator, plan_clearance
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file


def first(preset, tracks=(), **changes):
    """Settings of a preset, and the first decision."""
    values = TABLE.resolve({**load_parameter_file(preset), **changes})
    settings = guidance_settings(values)
    return settings, GuidanceLaw(settings, settings.world).step(
        Observation(0, np.array(values['initial_pose']), tracks)
    )


@pytest.mark.parametrize('preset', ['case3', 'corridor', 'goals', 'endless'])
def test_its_least_is_the_worst_clearance_of_the_decision(preset):
    settings, decision = first(preset)
    along = plan_clearance(settings, settings.world, decision)
    assert along.shape == (len(decision.plan.poses),)
    assert along.min() == pytest.approx(decision.worst_clearance, abs=1e-9)
    assert along.max() > along.min()


def test_the_robot_and_its_slip_count():
    settings, decision = first('case3_wide', **{'robot.radius': 0.1})
    assert plan_clearance(settings, settings.world, decision).min() == pytest.approx(
        decision.worst_clearance, abs=1e-9
    )
    plan, slipping = decision.plan, settings.robot.slipping(0.1)
    durations = plan.horizon.durations
    poses = slipping.roll_out(plan.poses[0], plan.controls, durations)
    found = Validator(settings).check(
        PlanStart(poses[0], slipping, settings.world), plan.controls, durations
    )
    decision = decision._replace(wheel_slip=0.1, plan=plan._replace(poses=poses))
    assert plan_clearance(settings, settings.world, decision).min() == pytest.approx(
        found.worst_margin, abs=1e-9
    )


@pytest.mark.parametrize('delay', [0.0, 0.1])
def test_what_moves_counts_where_it_will_be(delay):
    tracks = (Track(3, -100_000_000, 0.2, 5.0, -8.3, -0.4, 0.0),)
    settings, decision = first('moving', tracks, command_delay=delay)
    assert decision.tracks == tracks
    along = plan_clearance(settings, settings.world, decision)
    assert along.min() == pytest.approx(decision.worst_clearance, abs=1e-9)
    assert np.any(
        along < plan_clearance(settings, settings.world, decision._replace(tracks=())) - 0.01
    )


def test_the_last_pose_has_its_own_clearance():
    settings, decision = first('case1')
    along, (x, y, _) = plan_clearance(settings, settings.world, decision), decision.plan.poses[-1]
    assert along[-1] == pytest.approx(1.0 - abs(np.hypot(x, y) - 10.0), abs=1e-12)


def test_without_a_plan_there_is_nothing_to_tell():
    settings, decision = first('case1')
    with pytest.raises(ValueError, match='wanted one with a plan'):
        plan_clearance(settings, settings.world, decision._replace(plan=None))
