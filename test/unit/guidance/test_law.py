"""The guidance law in closed loop with an exact robot."""

import math
import pickle
import sys
import tracemalloc
from dataclasses import replace
from itertools import pairwise
from operator import attrgetter

import numpy as np
import pytest
from scenarios import (
    CASES,
    FIRST,
    MS,
    ON_TIME,
    PERIOD,
    ROAD,
    SECOND,
    SETTLED,
    START,
    clearance,
    closed_loop,
    drive,
    reconfigure,
    settings,
    with_plans,
)

from cmpsp_ros.guidance import (
    GuidanceLaw,
    Observation,
    Safety,
    SolverSettings,
    Weights,
    to_nanoseconds,
)
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file
from cmpsp_ros.world.obstacles import Obstacle


def assert_arrives(run, given, miss=1e-6, steps=50):
    assert len(run.moves) == steps
    assert {decision.level for decision in run.moves} <= SETTLED
    assert run.miss(given.goal) < miss
    assert clearance(run.path, given) >= -1e-9
    assert np.abs(run.controls).max() <= given.robot.max_wheel_speed


@pytest.mark.parametrize('name', CASES)
def test_cases_of_the_paper(name):
    given = CASES[name]
    run = closed_loop(given)
    assert_arrives(run, given)
    assert [decision.step for decision in run.moves] == list(range(50))
    assert run.decisions[-1].finished
    # What a decision says of itself is what then happens.
    start = np.array(START)
    for decision in run.moves:
        wheels = decision.wheel_speeds[None]
        np.testing.assert_array_equal(decision.twist, given.robot.twist(wheels)[0])
        np.testing.assert_allclose(decision.plan.poses[0], start, atol=1e-12)
        path = given.robot.roll_out(start, np.repeat(wheels, 400, axis=0), np.full(400, 5e-4))
        assert decision.clearance == pytest.approx(clearance(path, given), abs=2e-5)
        assert decision.worst_clearance <= decision.clearance
        assert 0.0 < decision.time_left <= 10.0
        solver = given.solver
        most = solver.initial_iterations if decision.step == 0 else solver.iterations_per_step
        assert 1 <= decision.iterations <= most
        assert decision.reason
        if decision.reason.startswith('The plan meets every constraint.'):
            assert decision.worst_clearance >= -1e-3, decision.step
            assert decision.terminal_error < 1e-2, decision.step
        start = path[-1]
    times_left = [decision.time_left for decision in run.moves]
    np.testing.assert_allclose(times_left, 10.0 - 0.2 * np.arange(50), atol=1e-12)


def test_two_runs_give_the_same_bits():
    one, other = (closed_loop(CASES['case 3']) for _ in range(2))
    for first, second in zip(one.decisions, other.decisions, strict=True):
        for name, value in first._asdict().items():
            if name == 'plan':
                continue
            np.testing.assert_array_equal(value, getattr(second, name), err_msg=name)
        if first.plan is not None:
            for part in ('controls', 'poses', 'horizon.edges'):
                read = attrgetter(part)
                np.testing.assert_array_equal(read(first.plan), read(second.plan))


def test_a_timer_measures_and_decides_nothing():
    ticks = iter(range(0, 10**9, 1_500_000))
    given = with_plans(CASES['case 3'], 1, 2)
    timed, plain = (
        GuidanceLaw(given, given.world, lambda: next(ticks)),
        GuidanceLaw(given, given.world),
    )
    pose = np.array(START)
    one, other = timed.step(Observation(5, pose)), plain.step(Observation(5, pose))
    np.testing.assert_array_equal(one.wheel_speeds, other.wheel_speeds)
    # The first guess, and its improvement.
    assert one.phases['solve'] == pytest.approx(3.0)
    assert set(one.phases) == {'solve', 'audit'}
    assert set(other.phases.values()) == {0.0}


@pytest.mark.parametrize('rate', [20, 30, 50, 67])
def test_odometry_of_any_rate_gives_a_decision_a_period(rate):
    given = CASES['case 3']
    stamps = [k * 1_000_000_000 // rate for k in range(10 * rate + 1)]
    run = drive(GuidanceLaw(given, given.world), given, stamps, pieces=5)
    assert_arrives(run, given, miss=1e-2)


@pytest.mark.parametrize('interval', [200, 250, 290])
def test_a_thin_pole_is_passed_whatever_the_rate_of_odometry(interval):
    """Steps get up to half a period longer than the period, and a pole fits between their ends."""
    for place in range(12, 20, 2):
        angle = 0.012 * place - 0.9
        pole = Obstacle('pole', (9.98 * math.cos(angle), 9.98 * math.sin(angle)), 0.05)
        given = settings((pole,), 51.0, ROAD)
        stamps = [*range(0, 10_000 * MS, interval * MS), 10_000 * MS]
        run = drive(GuidanceLaw(given, given.world), given, stamps)
        for decision in run.moves:
            assert decision.level in SETTLED, (place, decision.step, decision.reason)
        assert clearance(run.path, given) >= -1e-9
        assert run.miss() < 1e-2


def test_commands_depend_on_time_since_the_first_odometry_alone():
    given = CASES['case 2']
    one = drive(GuidanceLaw(given, given.world), given, ON_TIME)
    epoch = 1_763_697_269_123_456_789
    other = drive(GuidanceLaw(given, given.world), given, [epoch + stamp for stamp in ON_TIME])
    np.testing.assert_array_equal(one.controls, other.controls)
    assert other.decisions[3].stamp == epoch + 3 * PERIOD


def test_heading_wrapped_or_not():
    given = CASES['case 3']

    class Wrapping(GuidanceLaw):
        turns = 0

        def step(self, seen):
            turned = np.array([0.0, 0.0, self.turns * math.tau])
            return super().step(seen._replace(pose=seen.pose + turned))

    plain, law = closed_loop(given), Wrapping(given, given.world)
    for turns in (-1, 2):
        law.reset()
        law.turns = turns
        run = drive(law, given, ON_TIME)
        np.testing.assert_allclose(run.controls, plain.controls, atol=1e-6)


@pytest.mark.parametrize(
    'changes',
    [
        {'weights': Weights(control_effort=0.01)},
        {'weights': Weights(control_rate=0.5)},
        {'weights': Weights(control_rate=0.5, control_effort=0.01)},
        {'solver': SolverSettings(hessian='exact')},
        {'solver': SolverSettings(hessian='projected'), 'weights': Weights(control_rate=0.1)},
        {'solver': SolverSettings(iterations_per_step=5)},
        {'solver': SolverSettings(heading_trust_region=0.3)},
        {'safety': Safety(margin=0.05)},
        {'robot_radius': 0.08},
    ],
    ids=str,
)
def test_other_settings_arrive_too(changes):
    given = replace(CASES['case 3'], **changes)
    run = closed_loop(given)
    assert_arrives(run, given)
    wanted = changes.get('robot_radius', 0.0)
    assert clearance(run.path, given) >= wanted - 1e-6


def test_control_rate_makes_commands_smoother():
    def roughness(weight):
        run = closed_loop(replace(CASES['case 2'], weights=Weights(control_rate=weight)))
        return (np.diff(run.controls[:50], axis=0) ** 2).sum()

    assert roughness(5.0) < 0.9 * roughness(0.0)


def test_samples_alone_are_clear_where_that_is_all_that_was_asked():
    given = replace(CASES['case 3'], safety=Safety(between_samples=False))
    run = closed_loop(given)
    assert run.miss() < 1e-6
    at_samples = np.array([driven[-1] for driven in run.driven])
    assert clearance(at_samples, given) >= -1e-3
    assert clearance(run.path, given) >= -0.05


@pytest.mark.parametrize('final_time', [10.09, 10.05, 10.13, 9.95])
def test_final_time_that_is_no_whole_number_of_periods(final_time):
    given = replace(CASES['case 3'], final_time=final_time)
    final = round(final_time * 1e9)
    stamps = [*(stamp for stamp in range(0, final, PERIOD)), final]
    run = drive(GuidanceLaw(given, given.world), given, stamps)
    assert run.miss() < 1e-2
    assert clearance(run.path, given) >= -1e-9
    assert {decision.level for decision in run.moves} <= SETTLED


def test_reset_begins_again():
    given = CASES['case 3']
    law = GuidanceLaw(given, given.world)
    one = drive(law, given, ON_TIME)
    law.reset()
    other = drive(law, given, [stamp + 77 for stamp in ON_TIME])
    np.testing.assert_array_equal(one.controls, other.controls)
    assert [decision.step for decision in other.moves] == list(range(50))
    law.reset()
    assert law.step(Observation(3, np.array(START))).step == 0, 'time may go back across a reset'


def test_reconfigure_with_the_same_settings_changes_nothing():
    given = CASES['case 3']
    law, plain = GuidanceLaw(given, given.world), GuidanceLaw(given, given.world)
    one = drive(plain, given, ON_TIME)
    other = drive(law, given, ON_TIME, before=lambda run, stamp: reconfigure(law, given))
    # Only the active rows to begin with are forgotten, which shows in the last bits.
    np.testing.assert_allclose(one.controls, other.controls, rtol=1e-11)


def test_goal_at_the_centre_of_the_road_circle_touches_nothing():
    given = settings((FIRST,), 51.0, ROAD, goal=(0.0, 0.0))
    run = closed_loop(given)
    assert clearance(run.path, given) >= -1e-9
    assert len(run.moves) == 50


@pytest.mark.parametrize('final_time', [0.05, 0.2, 0.3, 0.4])
def test_shortest_final_times(final_time):
    start = (10.0, -1.2 * final_time, math.pi / 2)
    given = settings(final_time=final_time, guess=ROAD)
    final = round(final_time * 1e9)
    run = drive(
        GuidanceLaw(given, given.world), given, [*range(0, final, PERIOD), final], start=start
    )
    assert run.decisions[0].level in SETTLED
    assert clearance(run.path, given) >= 0.0
    if final_time >= 0.1:
        assert run.miss() < 1e-2


def test_a_live_change_keeps_the_planner_where_the_number_of_constraints_stays():
    """Another planner has a memory of its own, of about a megabyte."""
    given = settings((FIRST, SECOND), 51.0, ROAD)
    law = GuidanceLaw(given, given.world)
    run = drive(law, given, ON_TIME[:10])
    other = replace(given, weights=replace(given.weights, road_center=14.0))
    moved = replace(other, obstacles=(replace(FIRST, center=(8.1, -6.0)), SECOND))
    more = replace(moved, obstacles=(*moved.obstacles, replace(SECOND, center=(-8.0, 8.0))))
    for stamp, changed, is_kept in zip(
        ON_TIME[10:], (other, moved, more), (True, True, False), strict=False
    ):
        tracemalloc.start()
        reconfigure(law, changed)
        assert law.step(Observation(stamp, run.pose)).level in SETTLED
        grown, _ = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert (grown < 300_000) == is_kept


def test_it_foretells_whether_there_is_a_decision():
    law, begin, pose = (
        GuidanceLaw(CASES['case 3'], CASES['case 3'].world),
        1_000_000_007,
        np.array(START),
    )
    offsets = [0, 1, PERIOD // 2, PERIOD - 1, PERIOD, PERIOD, 0, 3 * PERIOD, 49 * PERIOD]
    stamps = [begin + offset for offset in [*offsets, 50 * PERIOD, 50 * PERIOD + 1, 51 * PERIOD]]
    foretold, decided = [], []
    for stamp in stamps:
        foretold.append(law.is_due(stamp))
        decided.append(law.step(Observation(stamp, pose)) is not None)
    assert foretold == decided
    assert decided == [True, *[False] * 3, True, *[False] * 2, *[True] * 3, False, True]


def test_after_a_halt_the_next_newer_odometry_is_due():
    law, pose = GuidanceLaw(CASES['case 3'], CASES['case 3'].world), np.array(START)
    law.step(Observation(0, pose))
    assert not law.is_due(1)
    law.halt(1, 'Why not.')
    assert law.is_due(1)
    assert not law.is_due(0)
    law.reset()
    assert law.is_due(0)


def test_a_copy_for_another_process_has_no_addresses_of_compiled_code():
    settings = CASES['case 3']
    world, pose = settings.world, np.array([[0.0, -9.25, 0.0]])
    before = world.free_space(settings).at(pose)
    copy = pickle.loads(pickle.dumps(world))
    assert not copy.__dict__.get('_spaces')
    np.testing.assert_array_equal(copy.free_space(settings).at(pose), before)


def test_a_nominal_step_runs_through_few_modules():
    settings = guidance_settings(TABLE.resolve(load_parameter_file('case3')))
    law, pose = GuidanceLaw(settings, settings.world), np.array([0.0, -9.25, 0.0])
    files = []

    def note(frame, event, _):
        if event == 'call' and 'cmpsp_ros' in frame.f_code.co_filename:
            files.append(frame.f_code.co_filename)

    period = to_nanoseconds(settings.control_period)
    for step in range(6):
        before = sys.getprofile()
        sys.setprofile(note if step == 5 else before)
        try:
            decision = law.step(Observation(step * period, pose))
        finally:
            sys.setprofile(before)
        law.after_step()
        speeds = decision.wheel_speeds[None]
        pose = settings.robot.roll_out(pose, speeds, np.array([settings.control_period]))[-1]
    files = [each for each in files if '/test/' not in each]
    assert 10 < len(set(files)) <= 20
    assert sum(one != other for one, other in pairwise(files)) <= 40
