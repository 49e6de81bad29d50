"""A robot with mass, motors and tyres: what the guidance's own model of it leaves out."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.simulator import Physics, Plant, PlantSettings
from cmpsp_ros.simulator.physics import PhysicsError

MS = 1_000_000
ROBOT = DifferentialDrive(max_wheel_speed=51.0)
SETTINGS = PlantSettings(ROBOT, (1.0, -2.0, 0.5), cmd_vel_timeout=0.0, physics=Physics())


def driven(seconds, linear, angular, start=0, **changes):
    """A plant that has heard one command, and the path since."""
    plant = Plant(replace(SETTINGS, **changes), start)
    plant.command(start, linear, angular)
    path = plant.advance(start + round(seconds * 1000) * MS)
    return plant, path


def test_it_stands_still_where_it_was_put():
    plant, _ = driven(2.0, 0.0, 0.0)
    assert plant.pose == pytest.approx([1.0, -2.0, 0.5], abs=1e-6)
    assert plant.wheel_speeds == pytest.approx([0.0, 0.0], abs=1e-3)


@pytest.mark.parametrize(('linear', 'angular'), [(0.5, 0.0), (0.5, 0.6), (0.0, 1.5), (-0.3, 0.4)])
def test_once_it_is_at_speed_it_drives_the_arc_of_its_model(linear, angular):
    plant, _ = driven(2.0, linear, angular)
    assert plant.twist == pytest.approx([linear, angular], abs=0.01)
    assert plant.wheel_speeds == pytest.approx(ROBOT.wheel_speeds(plant.twist), rel=0.02, abs=0.05)
    before = plant.pose
    plant.advance(3_000 * MS)
    wheels = ROBOT.wheel_speeds(np.array([linear, angular]))
    after = ROBOT.roll_out(before, wheels[None], np.ones(1))[1]
    assert plant.pose == pytest.approx(after, abs=0.02)


def test_it_gets_up_to_speed_as_torque_and_mass_allow():
    plant, _ = driven(0.2, 1.0, 0.0, physics=Physics(mass=2.0, torque=0.02))
    force = 2 * 0.02 / ROBOT.wheel_radius
    # Two wheels, solid spheres of a twentieth of the mass each, are turned as well.
    assert plant.twist[0] == pytest.approx(force / (2.0 * 1.04) * 0.2, rel=0.001)


def test_on_ice_it_spins_its_wheels():
    plant, _ = driven(0.2, 1.5, 0.0, physics=Physics(friction=0.05))
    assert plant.wheel_speeds.min() * ROBOT.wheel_radius > 1.2
    assert plant.twist[0] < 0.05 * 9.81 * 0.2


def test_encoders_count_what_the_wheels_turn_and_not_what_it_moves():
    encoders = {'physics': Physics(odometry='encoders', friction=0.05)}
    plant, _ = driven(0.5, 1.5, 0.0, **encoders)
    reckoned = plant.measure()
    assert math.dist(reckoned[:2], (1.0, -2.0)) > 3.0 * math.dist(plant.pose[:2], (1.0, -2.0))
    gentle, _ = driven(2.0, 0.3, 0.2, physics=Physics(odometry='encoders'))
    assert gentle.measure() == pytest.approx(gentle.pose, abs=0.02)
    assert driven(0.5, 0.5, 0.0)[0].measure() == pytest.approx(driven(0.5, 0.5, 0.0)[0].pose)


def test_the_same_commands_give_the_same_path_however_time_is_cut():
    one, path = driven(0.5, 1.0, 0.5)
    other = Plant(SETTINGS)
    other.command(0, 1.0, 0.5)
    cut = [each for stamp in range(7, 501, 17) for each in other.advance(stamp * MS)]
    cut += other.advance(500 * MS)
    assert [each.stamp_ns for each in cut] == [each.stamp_ns for each in path]
    assert all((a.pose == b.pose).all() for a, b in zip(cut, path, strict=True))
    assert (one.pose == other.pose).all()


def test_its_path_can_be_drawn_again_arc_by_arc():
    _, path = driven(1.0, 1.0, 0.5)
    assert max(b.stamp_ns - a.stamp_ns for a, b in pairwise(path)) <= 5 * MS
    for a, b in pairwise(path[100:]):
        wheels = ROBOT.wheel_speeds(a.twist)[None]
        end = ROBOT.roll_out(a.pose, wheels, np.array([(b.stamp_ns - a.stamp_ns) / 1e9]))[1]
        assert b.pose == pytest.approx(end, abs=1e-3)


def test_between_two_steps_it_goes_on():
    plant, _ = driven(1.0, 1.0, 0.0)
    here = plant.pose
    plant.advance(1_000 * MS + MS // 2)
    assert math.dist(plant.pose[:2], here[:2]) == pytest.approx(0.5e-3, rel=0.05)


def test_a_lag_delays_the_motors():
    quick, slow = (driven(0.1, 0.3, 0.0, wheel_lag=lag)[0] for lag in (0.0, 0.1))
    assert slow.twist[0] < 0.75 * quick.twist[0]
    assert driven(2.0, 0.3, 0.0, wheel_lag=0.1)[0].twist[0] == pytest.approx(0.3, abs=0.01)


def test_a_command_that_expires_stops_it():
    plant, _ = driven(2.0, 0.5, 0.0, cmd_vel_timeout=0.5)
    assert plant.twist == pytest.approx([0.0, 0.0], abs=1e-3)
    assert 0.15 < math.dist(plant.pose[:2], (1.0, -2.0)) < 0.4


def test_a_reset_puts_it_back_and_repeats_to_the_last_bit():
    plant, path = driven(0.5, 1.0, 0.5)
    plant.reset()
    assert plant.pose.tolist() == [1.0, -2.0, 0.5]
    plant.command(500 * MS, 1.0, 0.5)
    again = plant.advance(1_000 * MS)
    assert [each.stamp_ns - 500 * MS for each in again] == [each.stamp_ns for each in path]
    assert all((a.pose == b.pose).all() for a, b in zip(again, path, strict=True))


def test_it_goes_on_under_other_settings():
    plant, _ = driven(1.0, 0.5, 0.0)
    pose = plant.pose
    plant.reconfigure(replace(SETTINGS, wheel_lag=0.05))
    assert plant.pose == pytest.approx(pose, abs=1e-9)
    plant.advance(1_200 * MS)
    assert plant.twist[0] == pytest.approx(0.5, abs=0.02)


def test_the_heading_is_not_wrapped():
    plant, _ = driven(5.0, 0.0, 2.0)
    assert plant.pose[2] == pytest.approx(0.5 + 10.0, abs=0.3)


def test_a_robot_that_cannot_be_is_refused():
    with pytest.raises(PhysicsError, match='MuJoCo refuses the robot'):
        Plant(replace(SETTINGS, physics=Physics(mass=-1.0)))
