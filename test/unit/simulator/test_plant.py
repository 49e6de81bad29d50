"""The simulated robot: exact between events, whatever the steps in which time is advanced."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.simulator import OdometryErrors, Plant, PlantSettings, TwistError

MS = 1_000_000
SECOND = 1000 * MS
unhurried = hypothesis_settings(deadline=None)
"""The first call of a kernel compiles it."""

LIMITED = DifferentialDrive(max_wheel_speed=51.0)

twists = st.tuples(st.floats(-3.0, 3.0), st.floats(-40.0, 40.0))
instants = st.integers(0, 2 * SECOND)
command_lists = st.lists(st.tuples(instants, twists), max_size=5).map(
    lambda commands: sorted(commands, key=lambda command: command[0])
)
plant_settings = st.builds(
    PlantSettings,
    robot=st.just(LIMITED),
    initial_pose=st.tuples(*[st.floats(-10.0, 10.0)] * 3),
    cmd_vel_timeout=st.sampled_from([0.0, 0.05, 0.5, math.inf]),
    actuation_delay=st.sampled_from([0.0, 0.013, 0.7]),
)


def drive(settings, commands, stops, end=3 * SECOND):
    """Give every command at its time, with halts at ``stops``; the plant and its changes."""
    plant, changes = Plant(settings), []
    halts = [(stop, None) for stop in stops if stop <= end]
    for stamp, twist in sorted([*halts, *commands], key=lambda event: event[0]):
        changes += plant.advance(stamp)
        if twist is not None:
            plant.command(stamp, *twist)
    return plant, changes + plant.advance(end)


def speeds_by_hand(settings, commands, stamp):
    """Wheel speeds at an instant, from the rules alone."""
    delay = round(settings.actuation_delay * SECOND)
    effective = [(at + delay, twist) for at, twist in commands if at + delay <= stamp]
    if not effective:
        return np.zeros(2)
    since, twist = effective[-1]
    if 0.0 < settings.cmd_vel_timeout < math.inf and (
        stamp - since > round(settings.cmd_vel_timeout * SECOND)
    ):
        return np.zeros(2)
    wheel_speeds = settings.robot.wheel_speeds(np.array(twist))
    return wheel_speeds * min(1.0, 51.0 / max(np.abs(wheel_speeds).max(), 1e-12))


@unhurried
@given(plant_settings, command_lists, instants)
def test_what_is_driven_follows_the_rules_of_delay_and_timeout(settings, commands, stamp):
    commands = [command for command in commands if command[0] <= stamp]
    plant, _ = drive(settings, commands, [], end=stamp)
    plant.advance(stamp)
    assert np.allclose(plant.wheel_speeds, speeds_by_hand(settings, commands, stamp), atol=1e-9)


@hypothesis_settings(deadline=None, max_examples=30)
@given(plant_settings, command_lists)
def test_agrees_with_dense_numerical_integration(settings, commands):
    plant, changes = drive(settings, commands, [])
    grid = np.linspace(0, 3 * SECOND, 3001).astype(int)
    events = sorted({*grid.tolist(), *(change.stamp_ns for change in changes)})
    x, y, heading = settings.initial_pose
    for begin, end in pairwise(events):
        # A command or a time-out takes effect at one of the events, so the middle knows the speed.
        middle = (begin + end) / 2
        linear, angular = LIMITED.twist(speeds_by_hand(settings, commands, middle))
        duration = (end - begin) / SECOND
        x += linear * math.cos(heading + angular * duration / 2) * duration
        y += linear * math.sin(heading + angular * duration / 2) * duration
        heading += angular * duration
    # The midpoint rule errs by v * w^2 * h^3 / 24 a step, here below 2e-7 m a step.
    assert np.allclose(plant.pose, [x, y, heading], atol=3e-4)


@unhurried
@given(st.tuples(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6)), st.floats(1e-3, 1e3), st.booleans())
def test_no_wheel_ever_turns_faster_than_its_limit_and_the_curvature_stays(twist, limit, reset):
    plant = Plant(PlantSettings(robot=DifferentialDrive(max_wheel_speed=limit)))
    if reset:
        plant.reset()
    plant.command(0, *twist)
    plant.advance(0)
    asked = DifferentialDrive().wheel_speeds(np.array(twist))
    assert np.abs(plant.wheel_speeds).max() <= limit
    if np.abs(asked).max() > limit:
        assert np.abs(plant.wheel_speeds).max() == limit
        assume(np.abs(twist).max() > 1e-9)
        linear, angular = plant.twist
        size = np.hypot(*twist) * np.hypot(linear, angular)
        assert abs(linear * twist[1] - angular * twist[0]) <= 1e-9 * size
    else:
        assert (plant.wheel_speeds == asked).all()


@pytest.mark.parametrize('twist', [(math.nan, 0.0), (0.1, math.inf), (-math.inf, 0.0), (1e308, 0)])
def test_a_twist_that_is_no_number_is_refused_and_the_last_one_stays_until_it_expires(twist):
    plant = Plant(PlantSettings(robot=LIMITED, cmd_vel_timeout=0.5))
    plant.command(0, 0.2, 0.0)
    plant.advance(300 * MS)
    with pytest.raises(TwistError, match=r'twist \('):
        plant.command(300 * MS, *twist)
    plant.advance(500 * MS)
    assert plant.pose[0] == pytest.approx(0.1, abs=1e-12)
    assert plant.twist[0] == pytest.approx(0.2)
    [stop] = plant.advance(2 * SECOND)
    assert stop.stamp_ns == 500 * MS
    assert plant.pose[0] == pytest.approx(0.1, abs=1e-12)
    assert (plant.twist == 0.0).all()


def test_a_command_at_the_instant_of_the_time_out_is_in_time():
    plant = Plant(PlantSettings(robot=LIMITED, cmd_vel_timeout=0.2))
    plant.command(0, 0.2, 0.0)
    plant.advance(200 * MS)
    plant.command(200 * MS, 0.4, 0.0)
    changes = plant.advance(400 * MS)
    assert [change.stamp_ns for change in changes] == [200 * MS]
    assert plant.twist[0] == pytest.approx(0.4)


def test_the_past_is_refused():
    plant = Plant(PlantSettings(robot=LIMITED), start_ns=SECOND)
    with pytest.raises(ValueError, match='advance to 0 ns: expected 1000000000 ns or later'):
        plant.advance(0)
    with pytest.raises(ValueError, match='command at 0 ns'):
        plant.command(0, 0.0, 0.0)
    plant.command(2 * SECOND, 0.1, 0.0)
    with pytest.raises(ValueError, match='expected 2000000000 ns or later'):
        plant.command(SECOND, 0.1, 0.0)


def test_the_same_seed_gives_the_same_noise_of_the_size_asked_for():
    settings = PlantSettings(
        robot=LIMITED, initial_pose=(1.0, 2.0, 3.0), odometry=OdometryErrors(0.02, 0.1)
    )
    one, other = Plant(settings), Plant(settings)
    measured = np.array([one.measure() for _ in range(4000)])
    assert (measured == [other.measure() for _ in range(4000)]).all()
    assert np.allclose(measured.mean(axis=0), [1.0, 2.0, 3.0], atol=0.01)
    assert np.allclose(measured.std(axis=0), [0.02, 0.02, 0.1], rtol=0.1)


def test_a_reset_puts_everything_back_but_time():
    settings = PlantSettings(
        robot=LIMITED,
        initial_pose=(10.0, 0.0, 1.5),
        actuation_delay=0.1,
        odometry=OdometryErrors(0.1),
    )
    plant = Plant(settings)
    first = plant.measure()
    plant.command(0, 0.5, 1.0)
    plant.advance(SECOND)
    plant.command(SECOND, 0.5, 1.0)
    plant.reset()
    assert plant.stamp_ns == SECOND
    assert (plant.pose == [10.0, 0.0, 1.5]).all()
    assert (plant.wheel_speeds == 0.0).all()
    assert (plant.measure() == first).all()
    assert plant.advance(5 * SECOND) == []
    assert (plant.pose == [10.0, 0.0, 1.5]).all()


def test_the_heading_is_not_wrapped_and_what_is_handed_out_cannot_change_the_robot():
    plant = Plant(PlantSettings(robot=LIMITED, cmd_vel_timeout=0.0))
    plant.command(0, 0.0, 10.0)
    plant.advance(10 * SECOND)
    assert plant.pose[2] == pytest.approx(100.0)
    plant.pose[:] = plant.wheel_speeds[:] = 0.0
    plant.motion.wheel_speeds[:] = 0.0
    plant.advance(20 * SECOND)
    assert plant.pose[2] == pytest.approx(200.0)


def test_other_settings_count_from_now_on_and_the_path_goes_on_where_it_was():
    before = PlantSettings(robot=LIMITED, actuation_delay=0.5, cmd_vel_timeout=0.0)
    plant = Plant(before)
    plant.command(0, 0.2, 0.0)
    plant.advance(SECOND)
    plant.command(SECOND, 0.4, 0.0)
    after = replace(before, actuation_delay=0.0, cmd_vel_timeout=0.3)
    plant.reconfigure(after)
    plant.command(SECOND, 0.6, 0.0)
    assert plant.pose[0] == pytest.approx(0.1)
    changes = plant.advance(3 * SECOND)
    assert [change.stamp_ns for change in changes] == [1500 * MS, 1500 * MS, 1800 * MS]
    assert [change.twist[0] for change in changes] == pytest.approx([0.4, 0.6, 0.0])
    assert plant.pose[0] == pytest.approx(0.1 + 0.5 * 0.2 + 0.3 * 0.6)
