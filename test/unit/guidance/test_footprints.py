"""Robots with corners in closed loop: through gaps that a disc about them would not pass."""

import numpy as np
import pytest
from models import assert_arrives, drive

from cmpsp_ros.guidance import FallbackLevel

# What they call takes long to compile: by one worker.
pytestmark = pytest.mark.xdist_group('footprints')

PRESET = 'slot'


def test_the_preset_is_driven_through_the_slot():
    run = drive(PRESET)
    assert_arrives(*run)
    settings, _, motions, _ = run
    inside = [each.pose for each in motions if 1.25 < each.pose[0] < 1.6]
    assert np.abs([pose[2] for pose in inside]).max() < 0.15
    assert settings.circumscribed_radius > 0.19


def test_a_disc_around_the_robot_does_not_pass():
    settings, decisions, _, pose = drive(PRESET, 'robot.footprint=""', 'robot.radius=0.252')
    assert pose[0] < 1.4
    assert not {each.level for each in decisions} <= {FallbackLevel.NOMINAL}
    assert settings.circumscribed_radius == 0.252


@pytest.mark.parametrize(
    'given',
    [
        ('command_delay=0.1', 'actuation_delay=0.1'),
        ('robot.max_wheel_acceleration=15.0',),
        ('safety.between_samples=false',),
        ('robot.max_wheel_speed=0.0',),
    ],
    ids=['delay', 'acceleration', 'samples', 'no limit'],
)
def test_the_slot_under_other_settings(given):
    settings, decisions, motions, pose = drive(PRESET, *given)
    assert {each.level for each in decisions if not each.finished} == {FallbackLevel.NOMINAL}
    assert np.hypot(*(pose[:2] - settings.goal)) < 1e-3
    poses, twists = (np.array([getattr(m, name) for m in motions]) for name in ('pose', 'twist'))
    durations = np.diff([each.stamp_ns for each in motions]) / 1e9
    assert (
        settings.world.free_space(settings).along(poses[:-1], twists[:-1], durations).min() > -1e-3
    )
