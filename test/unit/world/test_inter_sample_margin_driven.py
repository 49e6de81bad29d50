"""Drives that keep clear at their samples, integrated densely and without any formula of ours."""

from __future__ import annotations

import math

import numpy as np
import pytest
from dense_drives import PIECES, error_of, integrated
from hypothesis import assume, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import Obstacle
from cmpsp_ros.world.roads import Annulus

ROAD = Annulus((0.5, -1.0), 9.0, 11.0)
shares = st.floats(-1.0, 1.0)


def clearances(places, center, radius):
    return np.linalg.norm(places - center, axis=1) - radius


drives = {
    'limit': st.floats(1.0, 80.0),
    'wheels': st.lists(st.tuples(shares, shares), min_size=1, max_size=5),
    'period': st.floats(0.02, 0.5),
    'heading': st.floats(-math.pi, math.pi),
    'bearing': st.floats(-math.pi, math.pi),
}


@hypothesis_settings(max_examples=400)
@given(**drives, radius=st.floats(0.01, 5.0), further=st.floats(0.0, 0.3))
def test_no_obstacle_is_touched(limit, wheels, period, heading, bearing, radius, further):
    robot = DifferentialDrive(max_wheel_speed=limit)
    obstacle = Obstacle('rock', (2.0, 9.0), radius)
    space = FreeSpace.of(ROAD, (obstacle,), 0.0).tightened(robot.twist_limits(), period)
    away = (space.radii[0] + further) * np.array([math.cos(bearing), math.sin(bearing)])
    pose = np.array([*(obstacle.center + away), heading])
    wheels = limit * np.array(wheels)
    places = integrated(pose, wheels, period, robot)
    # Each period whose two samples keep to the grown radius, one after the other.
    at_samples = clearances(places[::PIECES], obstacle.center, space.radii[0])
    kept = (at_samples[:-1] >= -1e-12) & (at_samples[1:] >= -1e-12)
    assume(kept.any())
    least = clearances(places, obstacle.center, radius)
    for k in np.flatnonzero(kept):
        within = least[k * PIECES : (k + 1) * PIECES + 1]
        assert within.min() >= -error_of(wheels, period, robot)


@hypothesis_settings(max_examples=400)
@given(**drives, edge=st.sampled_from(['inner', 'outer']), further=st.floats(0.0, 0.3))
def test_no_edge_of_the_road_is_crossed(limit, wheels, period, heading, bearing, edge, further):
    robot = DifferentialDrive(max_wheel_speed=limit)
    space = FreeSpace.of(ROAD, (), 0.0).tightened(robot.twist_limits(), period)
    inner, outer = space.annulus.inner.item(), space.annulus.outer.item()
    out = inner + further if edge == 'inner' else outer - further
    away = out * np.array([math.cos(bearing), math.sin(bearing)])
    pose = np.array([*(ROAD.center + away), heading])
    wheels = limit * np.array(wheels)
    distance = clearances(integrated(pose, wheels, period, robot), ROAD.center, 0.0)
    at = distance[::PIECES]
    fine = (at >= inner - 1e-12) & (at <= outer + 1e-12)
    kept = fine[:-1] & fine[1:]
    assume(kept.any())
    for k in np.flatnonzero(kept):
        within = distance[k * PIECES : (k + 1) * PIECES + 1]
        error = error_of(wheels, period, robot)
        assert within.min() >= ROAD.inner_radius - error
        assert within.max() <= ROAD.outer_radius + error


@pytest.mark.parametrize('period', [0.1, 0.2, 0.4])
def test_a_little_less_is_not_enough(period):
    """A radius smaller by a hundredth of what is added lets the worst arc touch: the sweep sees it.

    Otherwise these tests could not fail.
    """
    robot, obstacle = DifferentialDrive(max_wheel_speed=51.0), Obstacle('rock', (0.0, 0.0), 0.5)
    limits = robot.twist_limits()
    grown = float(FreeSpace.of(ROAD, (obstacle,), 0.0).tightened(limits, period).radii[0])
    kept = grown - 0.01 * (grown - obstacle.radius)
    touched = False
    for turn_rate in np.linspace(0.0, limits.turn_rate, 2000):
        speed = limits.speed - limits.half_track * turn_rate
        rim = turn_rate * robot.half_track
        wheels = np.array([[speed + rim, speed - rim]]) / robot.wheel_radius
        path = integrated(np.zeros(3), wheels, period, robot)
        half = np.linalg.norm(path[-1]) / 2.0
        if half >= kept:
            continue
        chord = path[-1] / (2.0 * half)
        # A rock beside the middle of the chord, `kept` from either end, on the arc's side.
        normal = np.array([chord[1], -chord[0]])
        rock = path[-1] / 2.0 + math.sqrt(kept**2 - half**2) * normal
        touched |= np.linalg.norm(path - rock, axis=1).min() < obstacle.radius - 1e-6
    assert touched
