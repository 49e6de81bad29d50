"""Slip, lag and varying delay of the simulated robot: each by itself, and all repeatable."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.simulator import OdometryErrors, Plant, PlantSettings

MS = 1_000_000
SECOND = 1000 * MS
LIMITED = DifferentialDrive(max_wheel_speed=51.0)
ORIGIN = (0.0, 0.0, 0.0)
unhurried = hypothesis_settings(deadline=None)
"""The first call of a kernel compiles it."""

twists = st.tuples(st.floats(-2.0, 2.0), st.floats(-3.0, 3.0))
instants = st.integers(0, 2 * SECOND)
command_lists = st.lists(st.tuples(instants, twists), max_size=6).map(
    lambda commands: sorted(commands, key=lambda command: command[0])
)
disturbed = st.builds(
    PlantSettings,
    robot=st.just(LIMITED),
    initial_pose=st.just(ORIGIN),
    cmd_vel_timeout=st.sampled_from([0.0, 0.05, 0.5]),
    actuation_delay=st.sampled_from([0.0, 0.06]),
    actuation_jitter=st.sampled_from([0.0, 0.3]),
    actuation_period=st.sampled_from([0.0, 0.033]),
    wheel_lag=st.sampled_from([0.0, 1e-4, 0.05, 0.4]),
    wheel_slip=st.sampled_from([(0.0, 0.0), (0.1, 0.03)]),
    wheel_slip_stddev=st.sampled_from([0.0, 0.2]),
    seed=st.integers(0, 3),
)


def drive(settings, commands, stops=(), end=3 * SECOND):
    """Give every command at its time, with halts at ``stops``; the plant and its changes."""
    plant, changes = Plant(settings), []
    halts = [(stop, None) for stop in stops]
    for stamp, twist in sorted([*halts, *commands], key=lambda event: event[0]):
        changes += plant.advance(stamp)
        if twist is not None:
            plant.command(stamp, *twist)
    return plant, changes + plant.advance(end)


@unhurried
@given(disturbed, command_lists, st.lists(instants, max_size=20))
def test_the_steps_of_time_make_no_difference_to_a_disturbed_robot_either(
    settings, commands, stops
):
    coarse, coarse_changes = drive(settings, commands)
    fine, fine_changes = drive(settings, commands, stops)
    assert (fine.pose == coarse.pose).all()
    for one, other in zip(fine_changes, coarse_changes, strict=True):
        assert one.stamp_ns == other.stamp_ns
        assert (one.pose == other.pose).all()
        assert (one.wheel_speeds == other.wheel_speeds).all()


@unhurried
@given(disturbed, command_lists)
def test_the_changes_are_enough_to_draw_the_disturbed_path_again(settings, commands):
    plant, changes = drive(settings, commands)
    pose, stamp, twist = np.zeros(3), 0, np.zeros(2)
    for change in [*changes, plant.motion]:
        wheels = LIMITED.wheel_speeds(twist)[None]
        pose = LIMITED.roll_out(pose, wheels, np.array([(change.stamp_ns - stamp) / 1e9]))[1]
        assert np.allclose(pose, change.pose, atol=1e-9)
        pose, stamp, twist = change.pose, change.stamp_ns, change.twist


@unhurried
@given(disturbed, command_lists)
def test_no_command_overtakes_another_whatever_the_jitter(settings, commands):
    settings = replace(settings, cmd_vel_timeout=0.0, wheel_lag=0.0)
    plant, changes = drive(settings, commands)
    asked = [LIMITED.wheel_speeds(np.array(twist)) for _, twist in commands]
    asked = [each * min(1.0, 51.0 / max(np.abs(each).max(), 1e-12)) for each in asked]
    assert len(changes) == len(commands)
    for change, (stamp, _), wheels in zip(changes, commands, asked, strict=True):
        assert np.allclose(change.wheel_speeds, wheels)
        assert change.stamp_ns >= stamp + round(settings.actuation_delay * SECOND)
    assert (np.diff([change.stamp_ns for change in changes]) >= 0).all()
    assert plant.stamp_ns == 3 * SECOND


@unhurried
@given(disturbed, command_lists)
def test_a_delay_shifts_the_path_in_time_and_changes_nothing_else(settings, commands):
    undelayed = {'actuation_jitter': 0.0, 'actuation_delay': 0.0, 'actuation_period': 0.0}
    settings = replace(settings, **undelayed)
    delayed = replace(settings, actuation_delay=0.25)
    _, now = drive(settings, commands)
    _, later = drive(delayed, commands, end=3 * SECOND + 250 * MS)
    for one, other in zip(now, later, strict=True):
        assert other.stamp_ns == one.stamp_ns + 250 * MS
        assert (other.pose == one.pose).all()


@unhurried
@given(disturbed, command_lists)
def test_every_disturbance_has_random_numbers_of_its_own(settings, commands):
    settings = replace(settings, cmd_vel_timeout=0.0, wheel_lag=0.0)
    quiet = replace(settings, wheel_slip_stddev=0.0, odometry=OdometryErrors())
    _, changes = drive(settings, commands)
    _, without = drive(quiet, commands)
    assert [each.stamp_ns for each in changes] == [each.stamp_ns for each in without]
    noisy = replace(settings, actuation_jitter=0.0, odometry=OdometryErrors(0.1, 0.1, dropout=0.5))
    steady = replace(noisy, odometry=OdometryErrors())
    assert (drive(noisy, commands)[0].pose == drive(steady, commands)[0].pose).all()


def test_slip_takes_its_part_of_what_each_wheel_turns():
    plant = Plant(PlantSettings(LIMITED, ORIGIN, cmd_vel_timeout=0.0, wheel_slip=(0.1, 0.2)))
    plant.command(0, 1.0, 0.0)
    plant.advance(SECOND)
    turned = 1.0 / 0.035
    assert plant.wheel_speeds == pytest.approx([turned, turned])
    assert plant.twist == pytest.approx([0.85, (0.9 - 0.8) / (2 * 0.055)])
    assert plant.pose[2] == pytest.approx(plant.twist[1])


def test_random_slip_is_drawn_anew_for_each_wheel_and_command():
    plant = Plant(
        PlantSettings(LIMITED, ORIGIN, wheel_slip=(0.1, 0.1), wheel_slip_stddev=0.02, seed=3)
    )
    grips = []
    for k in range(400):
        plant.command(k * 10 * MS, 1.0, 0.0)
        plant.advance(k * 10 * MS)
        grips.append(LIMITED.wheel_speeds(plant.twist) / plant.wheel_speeds)
    assert np.mean(grips, axis=0) == pytest.approx([0.9, 0.9], abs=0.005)
    assert np.std(grips, axis=0) == pytest.approx([0.02, 0.02], rel=0.2)
    assert np.corrcoef(np.transpose(grips))[0, 1] == pytest.approx(0.0, abs=0.15)


def test_a_wheel_that_has_lost_its_grip_pushes_nowhere():
    plant = Plant(PlantSettings(LIMITED, ORIGIN, wheel_slip=(1.0, 1.0), wheel_slip_stddev=0.0))
    plant.command(0, 1.0, 1.0)
    plant.advance(SECOND)
    assert (plant.pose == 0.0).all()


def test_the_delay_varies_between_its_bounds():
    plant = Plant(
        PlantSettings(
            LIMITED, ORIGIN, cmd_vel_timeout=0.0, actuation_delay=0.05, actuation_jitter=0.02
        )
    )
    delays = []
    for k in range(300):
        plant.command(k * 100 * MS, 0.1, 0.0)
        [change] = plant.advance((k + 1) * 100 * MS - 1)
        delays.append(change.stamp_ns - k * 100 * MS)
    assert 50 * MS <= min(delays) < 51 * MS
    assert 69 * MS < max(delays) <= 70 * MS


def test_a_controller_with_a_period_takes_commands_at_its_next_instant():
    given = PlantSettings(
        LIMITED, ORIGIN, cmd_vel_timeout=0.0, actuation_delay=0.05, actuation_period=0.03
    )
    plant = Plant(given, 7)
    plant.command(7 + 5 * MS, 0.1, 0.0)
    plant.command(7 + 9 * MS, 0.2, 0.0)
    plant.command(7 + 10 * MS, 0.3, 0.0)
    plant.command(7 + 11 * MS, 0.4, 0.0)
    changes = [(each.stamp_ns - 7, each.twist[0]) for each in plant.advance(SECOND)]
    wanted = [(60 * MS, 0.1), (60 * MS, 0.2), (60 * MS, 0.3), (90 * MS, 0.4)]
    assert changes == [(stamp, pytest.approx(speed)) for stamp, speed in wanted]
    # Its instants count from the last reset.
    plant.reset()
    plant.command(SECOND, 0.1, 0.0)
    assert plant.advance(2 * SECOND)[0].stamp_ns == SECOND + 60 * MS


def integrated(twist_of, end, slices=40_000):
    """Pose by the midpoint rule, so fine that it serves as the truth."""
    times = (np.arange(slices) + 0.5) * (end / slices)
    linear, angular = twist_of(times)
    step = end / slices
    heading = np.cumsum(angular) * step - angular * step / 2
    x, y = (linear * np.cos(heading)).sum() * step, (linear * np.sin(heading)).sum() * step
    return np.array([x, y, angular.sum() * step])


@pytest.mark.parametrize(
    ('twist', 'error'), [((1.5, 1.0), 5e-6), ((1.5, 0.1), 5e-7), ((0.1, 30.0), 1e-5)]
)
@pytest.mark.parametrize('lag', [0.02, 0.1, 0.5])
def test_the_lagging_robot_agrees_with_its_differential_equation(twist, error, lag):
    plant = Plant(PlantSettings(LIMITED, ORIGIN, cmd_vel_timeout=0.0, wheel_lag=lag))
    plant.command(0, *twist)
    plant.advance(2 * SECOND)

    def twist_of(times):
        share = 1.0 - np.exp(-times / lag)
        return twist[0] * share, twist[1] * share

    expected = integrated(twist_of, 2.0)
    assert np.hypot(*(plant.pose - expected)[:2]) < error
    assert plant.pose[2] == pytest.approx(expected[2], abs=1e-6)
    assert plant.twist == pytest.approx(np.array(twist) * -math.expm1(-2.0 / lag), rel=2e-2)


def test_lag_goes_on_from_the_speed_reached_when_the_command_changes():
    plant = Plant(PlantSettings(LIMITED, ORIGIN, cmd_vel_timeout=0.0, wheel_lag=0.1))
    plant.command(0, 1.0, 0.0)
    plant.advance(123 * MS)
    plant.command(123 * MS, -1.0, 0.0)
    changes = plant.advance(SECOND)
    reached = 1.0 - math.exp(-1.23)
    first = changes[0].twist[0]
    assert first < reached
    assert first == pytest.approx(-1.0 + (1.0 + reached) * math.exp(-0.025), abs=1e-3)
    plant.advance(10 * SECOND)
    assert plant.twist[0] == pytest.approx(-1.0, abs=1e-12)
    assert plant.advance(20 * SECOND) == []


def test_other_settings_change_the_lag_from_now_on_and_the_speed_goes_on():
    settings = PlantSettings(LIMITED, ORIGIN, cmd_vel_timeout=0.0, wheel_lag=0.1)
    plant = Plant(settings)
    plant.command(0, 1.0, 0.0)
    plant.advance(101 * MS)
    before, twist = plant.pose, plant.twist
    plant.reconfigure(settings)
    assert (plant.pose == before).all()
    assert plant.twist == pytest.approx(twist, rel=0.05)
    plant.reconfigure(replace(settings, wheel_lag=0.0))
    assert plant.twist[0] == pytest.approx(1.0)


def test_a_reset_begins_everything_random_again():
    settings = PlantSettings(
        LIMITED, ORIGIN, actuation_jitter=0.1, wheel_lag=0.1, wheel_slip_stddev=0.1, seed=4
    )
    plant, runs = Plant(settings), []
    for start in (0, 7 * SECOND):
        plant.advance(start)
        plant.reset()
        for k in range(5):
            plant.command(start + k * 200 * MS, 1.0, 0.2)
            plant.advance(start + (k + 1) * 200 * MS)
        runs.append(plant.pose)
    assert (runs[0] == runs[1]).all()
