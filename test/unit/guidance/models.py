"""Runs of presets in this process, for robots of every model."""

import math

import numpy as np

from cmpsp_ros.demo import load_scenario
from cmpsp_ros.guidance import FallbackLevel, GuidanceLaw, Observation
from cmpsp_ros.parameters import plant_settings
from cmpsp_ros.simulator import Plant


def drive(preset, *given, robot=None):
    """Settings, decisions, motions and the pose at the final time of a run of a preset."""
    scenario = load_scenario(preset, given, lockstep=True, robot=robot)
    settings = scenario.settings
    law, plant = GuidanceLaw(settings, settings.world), Plant(plant_settings(scenario.values))
    pose, decisions, motions = plant.pose, [], [plant.motion]
    final = round(settings.final_time * 1e9)
    for stamp in range(0, final + 4 * 10**9, 20_000_000):
        motions += [*plant.advance(stamp), plant.motion]
        pose = plant.pose if stamp <= final else pose
        decision = law.step(Observation(stamp, plant.measure()))
        if decision is not None:
            law.after_step()
            decisions.append(decision)
            plant.command(stamp, *decision.twist.tolist())
    return settings, decisions, motions, pose


def clearance(settings, motions):
    poses, twists = (np.array([getattr(m, name) for m in motions]) for name in ('pose', 'twist'))
    durations = np.diff([each.stamp_ns for each in motions]) / 1e9
    return settings.world.clearance(settings, poses[:-1], twists[:-1], durations).min()


def assert_arrives(settings, decisions, motions, pose):
    on_the_way = [each for each in decisions if not each.finished]
    assert {each.level for each in on_the_way} == {FallbackLevel.NOMINAL}
    assert np.hypot(*(pose[:2] - settings.goal)) < 1e-3
    if settings.goal_heading is not None:
        assert abs(math.remainder(pose[2] - settings.goal_heading, math.tau)) < 1e-2
    assert clearance(settings, motions) > 0.0
    fastest = max(np.abs(each.wheel_speeds).max() for each in decisions)
    assert fastest <= settings.robot.max_wheel_speed
    assert np.abs([each.wheel_speeds for each in motions]).max() <= fastest * (1.0 + 1e-12)


def assert_the_same(one, other):
    """Two runs are the same, bit for bit."""
    for mine, its in zip(one[1], other[1], strict=True):
        assert mine.twist.tobytes() == its.twist.tobytes()
        assert mine.reason == its.reason
    assert one[2][-1].pose.tobytes() == other[2][-1].pose.tobytes()
