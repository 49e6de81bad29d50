"""Commands under way: what is foreseen is what a delayed robot drives."""

import numpy as np
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from cmpsp_ros.guidance.prediction.pending_commands import PendingCommands
from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.simulator import Plant, PlantSettings

MS = 1_000_000
SECOND = 1000 * MS
ROBOT = DifferentialDrive()
unhurried = hypothesis_settings(deadline=None)
"""The first call of a kernel compiles it."""

gaps = st.integers(1, 400 * MS)
speeds = st.tuples(*[st.floats(-50.0, 50.0)] * 2).map(np.array)
commands = st.lists(st.tuples(gaps, speeds), max_size=8)


@unhurried
@given(commands, gaps, st.integers(0, 700 * MS))
def test_the_robot_is_where_it_was_foreseen_to_be_when_a_command_takes_effect(given_, now, delay):
    settings = PlantSettings(ROBOT, cmd_vel_timeout=0.0, actuation_delay=delay / SECOND)
    plant, under_way, stamp = Plant(settings), PendingCommands(), 0
    for gap, wheel_speeds in given_:
        stamp += gap
        under_way.add(stamp, wheel_speeds)
        plant.command(stamp, *ROBOT.twist(wheel_speeds))
    stamp += now
    plant.advance(stamp)
    wheel_speeds, durations = under_way.until(stamp, delay)
    foreseen = ROBOT.roll_out(plant.pose, wheel_speeds, durations)[-1]
    plant.advance(stamp + delay)
    assert np.allclose(foreseen, plant.pose, atol=1e-9)
    assert np.isclose(durations.sum(), delay / SECOND, atol=1e-12)


def test_without_a_delay_nothing_is_under_way():
    under_way = PendingCommands()
    under_way.add(0, np.array([1.0, 2.0]))
    wheel_speeds, durations = under_way.until(SECOND, 0)
    assert wheel_speeds.shape == (0, 2)
    assert durations.shape == (0,)


def test_at_first_the_robot_stands_still():
    wheel_speeds, durations = PendingCommands().until(0, 60 * MS)
    assert wheel_speeds.tolist() == [[0.0, 0.0]]
    assert durations.tolist() == [0.06]


def test_the_command_in_force_is_followed_by_those_under_way():
    under_way = PendingCommands()
    for k in range(4):
        under_way.add(k * 100 * MS, np.full(2, k + 1.0))
    wheel_speeds, durations = under_way.until(400 * MS, 250 * MS)
    assert wheel_speeds[:, 0].tolist() == [2.0, 3.0, 4.0]
    assert np.allclose(durations, [0.05, 0.1, 0.1])


def test_a_command_by_the_clock_may_be_ahead_of_odometry_and_is_not_overtaken():
    under_way = PendingCommands()
    under_way.add(0, np.ones(2))
    under_way.add(500 * MS, np.zeros(2))
    under_way.add(450 * MS, np.full(2, 3.0))
    wheel_speeds, durations = under_way.until(550 * MS, 100 * MS)
    assert wheel_speeds.tolist() == [[1.0, 1.0], [3.0, 3.0]]
    assert np.allclose(durations, [0.05, 0.05])
