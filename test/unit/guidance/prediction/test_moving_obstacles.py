"""The law among obstacles that move, and the audit beside every shape there is."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from scenarios import CASES, PERIOD, ROAD, START, assert_is, settings, start_of

from cmpsp_ros.guidance import FallbackLevel, GuidanceLaw, MovingObstacles, Observation
from cmpsp_ros.guidance.messages import Track, Tracks
from cmpsp_ros.guidance.safety import Validator
from cmpsp_ros.world.obstacles import ROUGHNESS, Capsule, MovingDiscs, Obstacle, convex
from cmpsp_ros.world.roads import OpenFloor

PIECES = 200
ROOM = MovingObstacles(capacity=4, growth=0.02)
OPEN = replace(settings((), 51.0, ROAD), moving_obstacles=ROOM)
AMONG = replace(CASES['case 3'], moving_obstacles=ROOM)

ONCOMING = (9.3, -4.8, -0.45, -0.45, 0.3)
CROSSING = (11.1, -3.1, -0.25, -0.1, 0.3)


def told(movers, stamp, since=0):
    """Tracks of discs ``(x, y, vx, vy, radius)`` at a time [ns]."""
    seconds = (stamp - since) / 1e9
    return tuple(
        Track(number, stamp, radius, x + seconds * vx, y + seconds * vy, vx, vy)
        for number, (x, y, vx, vy, radius) in enumerate(movers)
    )


def drive(given_, movers, tell=told, start=START, steps=51):
    """Decisions of a closed loop, and the least clearance from the movers while it moved."""
    law, pose, decisions, least = GuidanceLaw(given_, given_.world), np.array(start), [], []
    parts = np.full(PIECES, 0.2 / PIECES)
    for step in range(steps):
        stamp = step * PERIOD
        decision = law.step(Observation(stamp, pose, tell(movers, stamp)))
        decisions.append(decision)
        path = given_.robot.roll_out(pose, np.tile(decision.wheel_speeds, (PIECES, 1)), parts)
        times = stamp / 1e9 + np.linspace(0.0, 0.2, PIECES + 1)
        for x, y, vx, vy, radius in movers:
            away = path[:, :2] - np.array([x, y]) - times[:, None] * np.array([vx, vy])
            if decision.wheel_speeds.any():
                least.append(float(np.linalg.norm(away, axis=1).min() - radius))
        pose = path[-1]
        if decision.finished:
            break
    return decisions, min(least, default=math.inf)


@pytest.mark.parametrize('given_', [OPEN, AMONG], ids=['open road', 'case 3'])
@pytest.mark.parametrize('movers', [[ONCOMING], [CROSSING], [ONCOMING, CROSSING]])
def test_the_goal_is_reached_past_what_moves(given_, movers):
    decisions, least = drive(given_, movers)
    assert {each.level for each in decisions[:-1]} == {FallbackLevel.NOMINAL}
    assert decisions[-1].terminal_error < given_.goal_tolerance
    assert least >= 0.0


@pytest.mark.parametrize('mover', [ONCOMING, CROSSING])
def test_without_being_told_it_would_have_hit_them(mover):
    _, least = drive(OPEN, [mover], tell=lambda _movers, _stamp: ())
    assert least < -0.1


def test_what_comes_into_sight_on_the_way_is_missed_too(fault):
    def late(movers, stamp):
        return told(movers, stamp) if stamp >= 10 * PERIOD else ()

    decisions, least = drive(OPEN, [ONCOMING], tell=late)
    assert_is(fault, decisions[10])
    assert {each.level for each in decisions[:-1]} == {FallbackLevel.NOMINAL}
    assert decisions[-1].terminal_error < OPEN.goal_tolerance
    assert least >= 0.0


def test_what_does_not_matter_changes_nothing():
    """Out of reach it asks for nothing, and the warm start goes on bit for bit."""

    def late(movers, stamp):
        return told(movers, stamp) if stamp >= 10 * PERIOD else ()

    alone, _ = drive(AMONG, [])
    beside, _ = drive(AMONG, [(60.0, 60.0, 0.1, 0.0, 0.5)], tell=late)
    for one, other in zip(alone, beside, strict=True):
        np.testing.assert_allclose(one.wheel_speeds, other.wheel_speeds, rtol=0.0, atol=1e-9)
    assert [each.iterations for each in alone[:-1]] == [each.iterations for each in beside[:-1]]


def test_more_than_there_is_room_for_are_audited_all_the_same(fault):
    few = replace(OPEN, moving_obstacles=replace(ROOM, capacity=1))
    movers = [ONCOMING, (20.0, 0.0, 0.0, 0.0, 0.5), CROSSING]
    decisions, least = drive(few, movers)
    assert least >= 0.0
    assert all(len(each.tracks) == 3 for each in decisions)
    assert_is(fault, decisions[0])


def test_what_is_not_told_of_again_is_forgotten(fault):
    """It is missed for as long as it is believed in, ever wider, and no longer."""
    known = Tracks()
    known.add(told([CROSSING], 0))

    def once(movers, stamp):
        return known.at(stamp, ROOM.timeout)

    decisions, _ = drive(AMONG, [], tell=once)
    last = round(ROOM.timeout * 1e9) // PERIOD
    assert [len(each.tracks) for each in decisions] == [1] * (last + 1) + [0] * (50 - last)
    assert_is(fault, decisions[last + 1])
    assert decisions[-1].terminal_error < AMONG.goal_tolerance


def test_what_drives_at_the_robot_is_evaded(fault):
    x, y, _ = START
    decisions, least = drive(OPEN, [(x + 0.9, y, -0.8, 0.0, 0.3)], steps=10)
    for decision in decisions:
        assert_is(fault, decision)
    assert least >= 0.0


def test_a_robot_in_the_way_is_led_out(fault):
    """An obstacle reported at the robot's own place, at rest, does not freeze it."""
    x, y, _ = START
    behind = (x - 0.25, y, 0.0, 0.0, 0.3)
    decisions, _ = drive(OPEN, [behind], steps=10)
    assert decisions[0].clearance < 0.0
    assert_is(fault, decisions[0])
    assert FallbackLevel.STOP not in {each.level for each in decisions}
    assert decisions[-1].clearance > 0.0


def test_from_what_drives_through_it_the_robot_creeps_away_until_it_has_passed():
    x, y, _ = START
    decisions, _ = drive(OPEN, [(x - 0.25, y, 0.3, -0.6, 0.3)], steps=10)
    touched = [each for each in decisions if 'touches the robot' in each.reason]
    assert touched[0] is decisions[0]
    assert 0.0 < decisions[0].twist[0] <= 0.05
    assert all(abs(each.twist[0]) <= 0.05 for each in touched)
    assert decisions[-1].twist[0] > 0.1


def test_a_robot_that_is_surrounded_stands(fault):
    """An obstacle that drives into a robot at rest is no collision of the robot's."""
    x, y, _ = START
    ring = [
        (x + 0.45 * math.cos(a), y + 0.45 * math.sin(a), 0.0, 0.0, 0.4)
        for a in np.linspace(0.0, math.tau, 9)[:-1].tolist()
    ]
    crowd = replace(OPEN, moving_obstacles=MovingObstacles(capacity=8, growth=0.0))
    decisions, least = drive(crowd, ring, steps=10)
    assert least >= -ROUGHNESS - 1e-9
    for decision in decisions:
        assert_is(fault, decision)
    assert math.dist(decisions[-1].plan.poses[0, :2], (x, y)) < 0.1


shares = st.floats(-1.0, 1.0)
near = st.tuples(st.floats(-0.8, 0.8), st.floats(-0.8, 0.8))
RECTANGLE = [(-0.2, -0.1), (0.2, -0.1), (0.2, 0.1), (-0.2, 0.1)]


def shifted(points, by):
    return [(x + by[0], y + by[1]) for x, y in points]


still = st.one_of(
    st.builds(Obstacle, st.just('disc'), near, st.floats(0.05, 0.5)),
    st.builds(Capsule, st.just('wall'), near, near, st.floats(0.05, 0.4)),
    near.map(lambda by: convex('box', shifted(RECTANGLE, by))),
)
movers = st.tuples(near, st.tuples(shares, shares), st.floats(0.05, 0.5))


def signed(obstacle, places):
    """Distance of places from an obstacle, edge by edge, negative inside a polygon."""
    corners = np.array(obstacle.corners)
    least, inside = np.full(len(places), np.inf), np.full(len(places), len(corners) > 2)
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = b - a
        part = np.clip((places - a) @ along / max(along @ along, 1e-300), 0.0, 1.0)
        least = np.minimum(least, np.linalg.norm(places - a - part[:, None] * along, axis=1))
        inside &= along[0] * (places - a)[:, 1] - along[1] * (places - a)[:, 0] >= 0.0
    return np.where(inside, -least, least) - obstacle.radius


@hypothesis_settings(max_examples=200)
@given(
    obstacles=st.lists(still, max_size=3),
    discs=st.lists(movers, max_size=3),
    wheels=st.tuples(shares, shares),
    radius=st.sampled_from([0.0, 0.1]),
    growth=st.sampled_from([0.0, 0.2]),
)
def test_no_plan_that_passes_comes_closer_than_it_may(obstacles, discs, wheels, radius, growth):
    """Densely integrated: clear, or no deeper in what it is too close to already and stands."""
    floor = replace(settings(tuple(obstacles), 51.0, ROAD), road=OpenFloor(), robot_radius=radius)
    states = [(*at, *velocity, size, growth, 1.0) for at, velocity, size in discs]
    names = tuple(f'moving {number}' for number in range(len(discs)))
    moving = MovingDiscs(names, np.array(states).reshape(-1, 7), np.full(len(discs), -1))
    seen = replace(moving, states=moving.states * [1, 1, 1, 1, 1, 0, 0])
    controls = 51.0 * np.tile(wheels, (3, 1))
    durations = np.array([0.2, 0.2])
    verdict = Validator(floor).check(
        start_of(floor, np.zeros(3), moving=moving, reachable=moving, touchable=seen),
        controls,
        durations,
    )
    parts = np.full(PIECES, 0.2 / PIECES)
    path = floor.robot.roll_out(np.zeros(3), np.tile(controls[0], (PIECES, 1)), parts)[:, :2]
    times = np.linspace(0.0, 0.2, PIECES + 1)
    fastest = abs(float(floor.robot.twist(controls[0])[0]))
    spare, margins = [], []
    for obstacle in obstacles:
        clear = signed(obstacle, path) - radius
        spare.append(clear.min() - min(clear[0], 0.0))
        margins.append(clear.min())
    for at, velocity, size in discs:
        there = np.array(at) + times[:, None] * np.array(velocity)
        grown = size + radius + (growth + 0.5 * times) * times
        clear = np.linalg.norm(path - there, axis=1) - grown
        away = clear.min() if clear[0] >= 0.0 else -math.inf
        if fastest <= 0.05:
            # It may creep away from where that is, and past what stands.
            near = np.linalg.norm(path - at, axis=1) - size - radius
            kept = near[0] if math.hypot(*velocity) > 0.05 else min(near[0], 0.0)
            away = max(away, near.min() - kept)
        spare += [away] if any(wheels) else []
        margins.append(clear.min())
    step = 0.2 * 3.6 / PIECES
    if verdict.passed:
        assert min(spare, default=0.0) >= -ROUGHNESS - 1e-9
    else:
        # It is not refused for nothing.
        assert min(spare) <= ROUGHNESS + step + 0.02
    if margins and math.isfinite(verdict.margin):
        assert verdict.margin <= min(margins) + 1e-9
        assert verdict.margin >= min(margins) - ROUGHNESS - step - 0.005
