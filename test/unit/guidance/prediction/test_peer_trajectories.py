"""Plans of other robots: what of a message is used, what is known at a time, and what laws do."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from fleet import Robot, among, drive
from scenarios import ROAD, SETTLED, settings

from cmpsp_ros.guidance import NANOSECONDS, Horizon, MovingObstacles, Plan
from cmpsp_ros.guidance.messages import PeerTrajectory, Track, TrackError, Tracks, read_keys
from cmpsp_ros.guidance.messages.tracks import track_keys
from cmpsp_ros.guidance.prediction.estimator import ObstacleTracker
from cmpsp_ros.world.roads import Annulus, OpenFloor

MS = 1_000_000
RADIUS = 0.15
FLOOR = replace(settings((), 51.0, ROAD), road=OpenFloor())
WIDE = replace(FLOOR, road=Annulus(inner_radius=8.5, outer_radius=11.5))


def header(stamp, frame='odom'):
    sec, nanosec = divmod(stamp, NANOSECONDS)
    return SimpleNamespace(frame_id=frame, stamp=SimpleNamespace(sec=sec, nanosec=nanosec))


def path(*points, stamp=0, frame='odom'):
    """A `nav_msgs/Path` of points ``(stamp, x, y)``."""
    poses = [
        SimpleNamespace(
            header=header(at), pose=SimpleNamespace(position=SimpleNamespace(x=x, y=y, z=0.0))
        )
        for at, x, y in points
    ]
    return SimpleNamespace(header=header(stamp, frame), poses=poses)


def test_a_plan_is_read():
    plan = PeerTrajectory.of(path((100, 1.0, 2.0), (300, 3.0, 2.0), stamp=100), '/r2', 'odom')
    assert plan == PeerTrajectory('/r2', 100, (100, 300), ((1.0, 2.0), (3.0, 2.0)))
    assert (plan.name, plan.key, plan.at_rest) == ('robot /r2', ('/r2', 100), False)
    assert [plan.position(at) for at in (0, 100, 200, 900)] == [
        (1.0, 2.0),
        (1.0, 2.0),
        (2.0, 2.0),
        (3.0, 2.0),
    ]


def test_until_a_delayed_command_takes_effect_it_drives_as_it_will_then():
    plan = PeerTrajectory.of(path((100, 1.0, 2.0), (300, 3.0, 2.0), stamp=50), '/r2', 'odom')
    assert (plan.stamps, plan.places[0]) == ((50, 100, 300), (0.5, 2.0))


@pytest.mark.parametrize(
    ('message', 'said'),
    [
        (path((0, 0.0, 0.0), frame='map'), "in frame 'map', wanted 'odom'"),
        (path(), 'has 0 poses'),
        (path((0, 0.0, math.nan)), 'pose 0 at 0, nan m'),
        (path((0, math.inf, 0.0)), 'pose 0 at inf, 0 m'),
        (path((0, 0.0, 0.0), (5, 1e9, 0.0)), 'pose 1 at 1e'),
        (path((0, 0.0, 0.0), (5, 0.0, 0.0), (5, 1.0, 0.0)), 'times that do not increase'),
        (path((0, 0.0, 0.0), stamp=1), 'times that do not increase'),
    ],
)
def test_what_cannot_be_used_is_refused_by_name(message, said):
    with pytest.raises(TrackError, match=said) as caught:
        PeerTrajectory.of(message, '/r2', 'odom')
    assert str(caught.value).startswith('The plan of /r2')


def test_keys_are_read_as_they_were_written():
    plan = PeerTrajectory.of(path((7, 0.0, 0.0), stamp=7), '/a/b', 'odom')
    known = [Track(-3, 5, 0.1, 0.0, 0.0, 0.0, 0.0), plan]
    assert read_keys(track_keys(known)) == [(-3, 5), ('/a/b', 7)]
    for bad in ('/a@', 'a@5', '/@5', '/a b@5'):
        with pytest.raises(ValueError, match='wanted obstacles as id@stamp'):
            read_keys(bad)


def test_a_plan_grows_old_and_a_robot_that_stands_does_not():
    known = Tracks()
    driving = PeerTrajectory('/r2', 0, (0, 10), ((0.0, 0.0), (1.0, 0.0)))
    standing = PeerTrajectory('/r3', 0, (0,), ((5.0, 0.0),))
    known.add([driving, standing])
    assert known.at(NANOSECONDS, 1.0) == (driving, standing)
    assert known.at(NANOSECONDS + 1, 1.0) == (standing,)
    assert known.at(3600 * NANOSECONDS, 1.0) == (standing,)
    # It says otherwise.
    again = replace(driving, id='/r3', stamp=3600 * NANOSECONDS)
    known.add([again])
    assert known.at(3601 * NANOSECONDS, 1.0) == (again,)


def test_the_way_is_foreseen_and_stands_at_its_end():
    second = NANOSECONDS
    plan = PeerTrajectory('/r2', 0, (0, second, 2 * second), ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0)))
    known = MovingObstacles(others=('/r1', '/r2'), others_radius=0.2, growth=0.1)
    discs = ObstacleTracker().update(second // 2, np.zeros(3), (plan,), known)
    centers, radii = discs.at_times(np.array([0.0, 0.5, 1.0, 5.0]))
    np.testing.assert_allclose(centers[:, 0], [[0.5, 0.0], [1.0, 0.0], [1.0, 0.5], [1.0, 1.0]])
    np.testing.assert_allclose(radii[:, 0], [0.25, 0.3, 0.35, 0.75])
    assert discs.names == ('robot /r2',)
    assert discs.slots.tolist() == [0]
    later = discs.after(0.75)
    np.testing.assert_allclose(later.states[0, :2], [1.0, 0.25])
    np.testing.assert_allclose(later.at_times(np.array([0.25]))[0][0, 0], [1.0, 0.5])


def test_where_a_plan_leads_at_an_instant():
    horizon = Horizon.between([0, 200 * MS, 400 * MS])
    poses = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.4], [2.0, 1.0, 0.4]])
    plan = Plan(horizon, np.zeros((3, 2)), poses)
    assert plan.pose_at(1000, 1000 + 100 * MS) == pytest.approx([0.5, 0.0, 0.2])
    assert plan.pose_at(1000, 1000 + 900 * MS) == [2.0, 1.0, 0.4]


def meeting(offset):
    """Two robots on one road, in opposite senses."""
    names = ['/r1', '/r2']
    given = among(WIDE, names, RADIUS)
    # With less work for a step they plan fewer ways past each other.
    given = replace(given, solver=replace(given.solver, work_rate=6e7))
    here, there = replace(given, goal=(10.0, 0.0)), replace(given, goal=(0.0, -10.0))
    return [
        Robot('/r1', here, (0.0, -10.0, 0.0)),
        Robot('/r2', there, (10.0, 0.0, -math.pi / 2), offset),
    ]


def crossing(count, offset):
    """Robots around a circle, each on its way to the place across."""
    names = [f'/r{number}' for number in range(count)]
    robots = []
    for number, name in enumerate(names):
        bearing = math.tau * number / count
        start = 5.0 * math.cos(bearing), 5.0 * math.sin(bearing)
        given = replace(among(FLOOR, names, RADIUS), goal=(-start[0], -start[1]))
        robots.append(Robot(name, given, (*start, bearing + math.pi), number * offset))
    return robots


def assert_arrived(robots):
    for each in robots:
        decided = [one for one in each.decisions if not one.finished]
        assert {one.level for one in decided} <= SETTLED
        assert each.decisions[-1].finished
        assert each.decisions[-1].terminal_error < each.given.goal_tolerance


@pytest.mark.parametrize(('offset', 'late'), [(0, 0), (20 * MS, 20 * MS), (100 * MS, 0)])
def test_two_that_meet_on_a_road_pass_each_other(offset, late):
    robots = meeting(offset)
    least, _ = drive(robots, 11.0, late)
    assert_arrived(robots)
    assert least > 0.1


def test_without_knowing_of_each_other_they_would_collide():
    robots = meeting(0)
    least, _ = drive(robots, 11.0, late=100 * NANOSECONDS)
    assert least < -0.2


@pytest.mark.parametrize(('count', 'offset'), [(2, 60 * MS), (3, 0), (4, 60 * MS)])
def test_ways_that_all_cross_at_one_place(count, offset):
    """All decide at once, and alike: only their plans break the symmetry."""
    robots = crossing(count, offset)
    least, _ = drive(robots, 11.0)
    assert_arrived(robots)
    assert least > 0.1


def test_a_robot_that_stands_in_the_way_is_passed():
    robots = crossing(2, 0)
    known = robots[0].known
    known.add([PeerTrajectory('/r9', 0, (0,), ((0.0, 0.0),))])
    known_to = replace(robots[0].given.moving_obstacles, others=('/r9',))
    robots[0] = Robot('/r0', replace(robots[0].given, moving_obstacles=known_to), robots[0].pose)
    robots[0].known = known
    _, paths = drive(robots[:1], 11.0)
    assert_arrived(robots[:1])
    assert np.hypot(*paths['/r0'].T[:2]).min() > 2.0 * RADIUS
    assert all(one.tracks[0].id == '/r9' for one in robots[0].decisions)


def places(rng, count):
    """Places on a floor of six metres, 0.8 m or more from each other."""
    found = []
    while len(found) < count:
        place = rng.uniform(-3.0, 3.0, 2)
        if all(np.linalg.norm(place - other) > 0.8 for other in found):
            found.append(place)
    return found


@pytest.mark.parametrize('late', [pytest.param(0, marks=pytest.mark.slow), 40 * MS])
def test_random_ways_of_five_robots_keep_apart(late):
    rng, names = np.random.default_rng(5), [f'/r{number}' for number in range(5)]
    for _ in range(3):
        robots = []
        for name, start, goal in zip(names, places(rng, 5), places(rng, 5), strict=True):
            given = replace(among(FLOOR, names, RADIUS), goal=tuple(goal.tolist()), final_time=8.0)
            towards = goal - start
            pose = (*start, math.atan2(towards[1], towards[0]))
            robots.append(Robot(name, given, pose, 20 * MS * int(rng.integers(10))))
        least, _ = drive(robots, 8.5, late)
        assert least > 0.0
