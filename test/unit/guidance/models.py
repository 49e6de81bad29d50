"""Runs of presets in this process, for robots of every model."""

import math

import numpy as np

from cmpsp_ros.demo import load_scenario
from cmpsp_ros.guidance import FallbackLevel, GuidanceLaw, Observation
from cmpsp_ros.guidance.safety import CHANGE_ROUNDING
from cmpsp_ros.parameters import plant_settings
from cmpsp_ros.robots import Ackermann
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
            decisions.append(decision)
            plant.command(stamp, *decision.twist.tolist())
    return settings, decisions, motions, pose


def clearance(settings, motions):
    poses, twists = (np.array([getattr(m, name) for m in motions]) for name in ('pose', 'twist'))
    durations = np.diff([each.stamp_ns for each in motions]) / 1e9
    return settings.world.clearance(settings, poses[:-1], twists[:-1], durations).min()


def assert_within_limits(settings, decisions, motions):
    """Of a car steering angle, its rate, acceleration and curvature are within their limits."""
    robot = settings.robot
    if not isinstance(robot, Ackermann):
        return
    controls = np.array(
        [(0.0, 0.0), *((each.wheel_speeds[0], each.steering_angle) for each in decisions)]
    )
    changes = np.abs(np.diff(controls, axis=0))
    assert np.abs(controls[:, 1]).max() <= robot.max_steering_angle
    assert changes[:, 0].max() <= settings.max_wheel_change + CHANGE_ROUNDING
    most_steered = robot.max_steering_rate * settings.control_period
    assert changes[:, 1].max() <= most_steered * (1.0 + 1e-6)
    speed, turn_rate = np.array([each.twist for each in motions]).T
    assert (np.abs(turn_rate) * robot.half_track <= np.abs(speed) * (1.0 + 1e-9)).all()


def assert_arrives(settings, decisions, motions, pose):
    on_the_way = [each for each in decisions if not each.finished]
    assert {each.level for each in on_the_way} == {FallbackLevel.NOMINAL}
    assert np.hypot(*(pose[:2] - settings.goal)) < 1e-3
    if settings.goal_heading is not None:
        assert abs(math.remainder(pose[2] - settings.goal_heading, math.tau)) < 1e-2
    assert_within_limits(settings, decisions, motions)
    # Samples alone may let the path between them cut a little.
    assert clearance(settings, motions) > (0.0 if settings.safety.between_samples else -1e-3)
    fastest = max(np.abs(each.wheel_speeds).max() for each in decisions)
    assert fastest <= settings.robot.max_wheel_speed
    assert np.abs([each.wheel_speeds for each in motions]).max() <= fastest * (1.0 + 1e-12)


def assert_the_same(one, other):
    """Two runs are the same, bit for bit."""
    for mine, its in zip(one[1], other[1], strict=True):
        assert mine.twist.tobytes() == its.twist.tobytes()
        assert mine.reason == its.reason
    assert one[2][-1].pose.tobytes() == other[2][-1].pose.tobytes()
