"""The goal is judged at the final time, also where odometry comes before and after it."""

from dataclasses import replace

import numpy as np
import pytest

from cmpsp_ros.guidance import GuidanceLaw, Observation
from cmpsp_ros.guidance.messages import Track
from cmpsp_ros.guidance.mission.goal_manager import GoalManager
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file
from cmpsp_ros.sensing import Sighting
from cmpsp_ros.world.grids import Cell, OccupancyGrid

END = 10_000_000_000


@pytest.fixture
def settings():
    return guidance_settings(TABLE.resolve(load_parameter_file('case3')))


def drive(settings, stamps, halts=()):
    """Decisions on odometry of these stamps, by exact arcs, and on halts by the clock."""
    law, pose, speeds, decisions = (
        GuidanceLaw(settings, settings.world),
        np.array([0.0, -9.25, 0.0]),
        None,
        [],
    )
    before = 0
    for stamp in sorted({*stamps, *halts}):
        if speeds is not None:
            duration = np.array([(stamp - before) / 1e9])
            pose = settings.robot.roll_out(pose, speeds[None], duration)[-1]
        before = stamp
        if stamp in halts:
            made = law.halt(stamp, 'The final time has passed.', finished=True)
        else:
            made = law.step(Observation(stamp, pose))
        if made is not None:
            decisions.append(made)
            speeds = made.wheel_speeds
    return decisions, pose, law


def at(rate, count):
    return [round(k * 1e9 / rate) for k in range(count)]


@pytest.mark.parametrize('halts', [(), (END + 4_000_000,)])
def test_odometry_that_does_not_meet_the_final_time_tells_the_miss_at_it(settings, halts):
    decisions, pose, law = drive(settings, at(29.73, 305), halts)
    assert law.ends_at == END
    finished = [each for each in decisions if each.finished and not each.halted]
    assert len(finished) > 1
    driven_on = settings.target.errors(pose)[0]
    assert driven_on > (0.004 if halts else 0.01)
    for each in finished:
        assert each.terminal_error < 1e-6
        assert not each.missed
        assert each.reason == 'The final time has passed.'


def test_odometry_that_meets_it_is_taken_as_it_is(settings):
    decisions, pose, _ = drive(settings, at(50, 510))
    last = decisions[-1]
    assert last.finished
    assert last.terminal_error == settings.target.errors(pose)[0]


def test_odometry_that_comes_much_later_is_judged_where_it_is(settings):
    decisions, pose, _ = drive(settings, [*at(50, 500), END + 2_000_000_000])
    assert decisions[-1].terminal_error == settings.target.errors(pose)[0] > 1.0
    assert decisions[-1].missed


MAPPED = {'final_time': 20.0, 'robot.max_wheel_acceleration': 50.0}
"""Out of a dead end in less time than it takes."""


@pytest.mark.parametrize('may_be_late', [False, True])
def test_a_goal_that_may_be_late_is_put_off_until_it_is_reached(may_be_late):
    given = {**load_parameter_file('dead_end'), **MAPPED, 'goal.may_be_late': may_be_late}
    values = TABLE.resolve(given)
    settings = guidance_settings(values)
    law, pose, stamp, decisions = (
        GuidanceLaw(settings, settings.world),
        np.array(values['initial_pose']),
        0,
        [],
    )
    while not decisions or not decisions[-1].finished:
        assert stamp < 60 * 10**9
        decisions.append(law.step(Observation(stamp, pose)))
        period = np.array([settings.control_period])
        pose = settings.robot.roll_out(pose, decisions[-1].wheel_speeds[None], period)[-1]
        stamp += round(settings.control_period * 1e9)
    put_off = [each for each in decisions if 'is put off by' in each.reason]
    assert decisions[-1].missed is not may_be_late
    assert bool(put_off) is may_be_late
    if may_be_late:
        assert decisions[-1].goal.time == (stamp - 200_000_000) / 1e9 > 20.0
        assert put_off[0].time_left > 20.0 - put_off[0].stamp / 1e9


def closed_in(x, y):
    """All around a place something is seen."""
    cells = np.full((60, 60), Cell.OCCUPIED, np.uint8)
    cells[10:50, 10:50] = Cell.FREE
    return OccupancyGrid((x - 1.5, y - 1.5, 0.0), 0.05, cells)


@pytest.mark.parametrize('is_stuck', [False, True])
def test_it_is_put_off_while_a_robot_that_is_stuck_gets_itself_out(is_stuck):
    given = {**load_parameter_file('people'), 'final_time': 20.0}
    settings = guidance_settings(TABLE.resolve(given))
    x, y, _ = pose = np.array(given['initial_pose'])
    seen = settings.world.seeing(closed_in(x, y))
    world = replace(seen, searched=seen.searched._replace(seen=seen.seen))
    manager = GoalManager(settings, settings.world)
    start = PlanStart(pose, settings.robot, world)
    by = manager.adapt(19_600_000_000, start, may_be_later=True, is_stuck=is_stuck)
    assert (by > 0.0) is is_stuck


@pytest.mark.parametrize('is_somebody_there', [False, True])
def test_it_is_put_off_where_somebody_may_close_the_only_path(is_somebody_there):
    given = {**load_parameter_file('people'), 'final_time': 20.0}
    settings = guidance_settings(TABLE.resolve(given))
    x, y, _ = pose = np.array(given['initial_pose'])
    grid = closed_in(x, y)
    law = GuidanceLaw(settings, settings.world)
    for stamp in (0, 200_000_000, 19_600_000_000):
        person = Track(Track.SEEN + 1, stamp, 0.25, x + 1.0, y, 0.0, 0.2)
        tracks = (person,) if is_somebody_there else ()
        law.step(Observation(stamp, pose, tracks, Sighting(stamp, grid)))
        law.after_step()
    assert (law.ends_at > 20_000_000_000) is is_somebody_there


@pytest.mark.parametrize(('away', 'is_earlier'), [(0.5, True), (4.5, True), (6.0, False)])
def test_it_comes_earlier_again_where_the_path_is_short_again_but_not_before_it_was_due(
    away, is_earlier
):
    given = {**load_parameter_file('people'), 'final_time': 10.0, 'goal.nominal_speed': 0.5}
    settings = guidance_settings(TABLE.resolve(given))
    manager, (x, y) = GoalManager(settings, settings.world), settings.goal
    far, near = (
        PlanStart(np.array([x - each, y, 0.0]), settings.robot, settings.world)
        for each in (10.0, away)
    )
    later = manager.adapt(5_000_000_000, far, may_be_later=True, is_stuck=False)
    assert (later, manager.final) == (pytest.approx(15.0), 25_000_000_000)
    earlier = manager.adapt(5_000_000_000, near, may_be_later=False, is_stuck=False)
    assert earlier == pytest.approx(-min(later, 20.0 - 2.0 * away) if is_earlier else 0.0)
    assert manager.final == manager.end == round((25.0 + earlier) * 1e9)
