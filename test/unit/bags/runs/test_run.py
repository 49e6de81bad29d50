"""A recorded run as arrays, and the path between its samples."""

import math
from dataclasses import replace

import numpy as np
import pytest
from bag_messages import (
    JOINTS,
    ODOMETRY,
    PATH,
    PLAIN_DECISION,
    SECOND,
    STATUS,
    joints,
    odometry,
    path,
    status,
    write_bag,
)
from hypothesis import given
from hypothesis import strategies as st

from cmpsp_ros.bags import BagError
from cmpsp_ros.bags.runs import DrivenPath, read_run, seen_at
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file
from cmpsp_ros.robots.motion import arc_ends, arc_from, reach_of
from cmpsp_ros.sensing import Track


def driven(twists, seconds, begin=5 * SECOND):
    """A path of arcs, each driven for so many seconds; the last twist begins at the end."""
    stamps = begin + np.concatenate([[0], np.cumsum(np.round(np.array(seconds) * 1e9))])
    poses = [np.array([1.0, 2.0, 0.5])]
    for twist, duration in zip(twists, seconds, strict=False):
        poses.append(arc_ends(poses[-1][None], np.array([twist]), np.array([duration]))[0])
    return DrivenPath(stamps.astype(np.int64), np.array(poses), np.array(twists, dtype=float))


def reached(path):
    """Least and greatest distance of each arc from the origin."""
    lengths = path.twists[:-1] * path.durations[:, None]
    arcs = np.column_stack([path.poses[:-1], lengths]).tolist()
    return np.array([reach_of(arc_from(*each), 0.0, 0.0) for each in arcs]).T


def at(stamp, x, heading, speed):
    return odometry(stamp, (x, 0.0, heading), (speed, 0.1))


def decision(stamp, **more):
    return status(**PLAIN_DECISION | {'stamp': stamp} | more)


def write(folder, topics):
    records = [
        (name, received, message)
        for name, (_, messages) in topics.items()
        for received, message in enumerate(messages)
    ]
    return write_bag(folder, records, kinds={name: kind for name, (kind, _) in topics.items()})


def topics(prefix=''):
    return {
        f'{prefix}/guidance/decision': (
            STATUS,
            [
                decision(7, step_ms='0.30000000000000004'),
                decision(9, fallback_level='stop', finished='true'),
            ],
        ),
        f'{prefix}/sim/truth': (ODOMETRY, [at(8, 1.0, 0.0, 1.0), at(9, 2.0, 3.5, 2.0)]),
        f'{prefix}/sim/wheel_speeds': (JOINTS, [joints(8, (1.0, 2.0)), joints(9, (3.0, 4.0))]),
        f'{prefix}/guidance/wheel_speeds': (JOINTS, [joints(8, (5.0, 6.0))]),
        f'{prefix}/odom': (ODOMETRY, [at(8, 8.0, 0.0, 1.0), at(9, 9.0, 0.0, 1.0)]),
    }


def test_at_a_sample_it_is_the_sample_and_between_two_it_is_on_the_arc():
    path_driven = driven([(1.0, 0.5), (2.0, -1.0), (0.0, 0.0)], [1.0, 0.5])
    for stamp, pose in zip(path_driven.stamps, path_driven.poses, strict=True):
        assert path_driven.at(int(stamp)).tolist() == pose.tolist()
    x, y, heading = path_driven.at(5 * SECOND + SECOND // 2)
    radius = 2.0
    assert heading == pytest.approx(0.75)
    assert x == pytest.approx(1.0 + radius * (math.sin(0.75) - math.sin(0.5)))
    assert y == pytest.approx(2.0 - radius * (math.cos(0.75) - math.cos(0.5)))
    assert path_driven.durations.tolist() == [1.0, 0.5]


TWISTS = st.tuples(st.floats(-2.0, 2.0), st.floats(-3.0, 3.0))


@given(
    twists=st.lists(TWISTS, min_size=4, max_size=4),
    parts=st.tuples(*[st.integers(0, 3 * SECOND)] * 3),
)
def test_a_part_of_the_path_is_the_path(twists, parts):
    whole = driven(twists, [1.0, 1.0, 1.0], begin=0)
    first, middle, last = sorted(parts)
    part = whole.between(first, last)
    assert (part.stamps[0], part.stamps[-1]) == (first, last)
    assert len(part.stamps) == len(part.poses) == len(part.twists)
    assert np.all(np.diff(part.stamps) >= 0)
    for stamp in (first, middle, last):
        assert part.at(stamp) == pytest.approx(whole.at(stamp), abs=1e-9)
    least, greatest = reached(part)
    whole_least, whole_greatest = reached(whole)
    assert least.min() >= whole_least.min() - 1e-9
    assert greatest.max() <= whole_greatest.max() + 1e-9


def test_a_simulated_run_is_read_from_the_simulator_s_own_topics(tmp_path):
    run = read_run(write(tmp_path / 'bag', topics()))
    first, last = run.decisions
    assert (first.stamp, first.level, first.reason) == (7, 'nominal', 'Well.')
    assert (first.finished, first.step_ms) == (False, 0.1 + 0.2)
    assert (last.level, last.finished, last.step_ms) == ('stop', True, None)
    assert run.plans == ()
    assert run.driven.stamps.tolist() == [8, 9]
    assert run.driven.poses[:, 0].tolist() == [1.0, 2.0]
    assert run.driven.poses[1, 2] == pytest.approx(3.5 - 2.0 * math.pi)
    assert run.driven.twists.tolist() == [[1.0, 0.1], [2.0, 0.1]]
    assert run.wheel_stamps.tolist() == [8, 9]
    assert run.wheel_speeds.tolist() == [[1.0, 2.0], [3.0, 4.0]]


def test_without_a_simulator_odometry_and_commands_stand_in(tmp_path):
    there = {name: each for name, each in topics().items() if not name.startswith('/sim')}
    there['/guidance/predicted_path'] = (PATH, [path(7, [(1.0, 2.0), (3.0, 4.0)])])
    run = read_run(write(tmp_path / 'bag', there))
    assert run.driven.poses[:, 0].tolist() == [8.0, 9.0]
    assert run.wheel_speeds.tolist() == [[5.0, 6.0]]
    (plan,) = run.plans
    assert plan.stamp == 7
    assert plan.points.tolist() == [[1.0, 2.0], [3.0, 4.0]]


def test_one_robot_of_several_is_read_by_its_namespace(tmp_path):
    both = {**topics('/r1'), **topics('/r2')}
    both['/r2/sim/truth'] = (ODOMETRY, [at(8, 50.0, 0.0, 1.0), at(9, 60.0, 0.0, 1.0)])
    bag = write(tmp_path / 'bag', both)
    assert read_run(bag, '/r1').driven.poses[0, 0] == 1.0
    assert read_run(bag, '/r2').driven.poses[0, 0] == 50.0


def test_of_two_at_one_instant_the_later_counts_and_time_is_put_in_order(tmp_path):
    there = topics()
    there['/sim/truth'] = (
        ODOMETRY,
        [at(9, 2.0, 0.0, 1.0), at(8, 1.0, 0.0, 1.0), at(9, 2.0, 0.0, 7.0)],
    )
    run = read_run(write(tmp_path / 'bag', there))
    assert run.driven.stamps.tolist() == [8, 9]
    assert run.driven.twists[:, 0].tolist() == [1.0, 7.0]


@pytest.mark.parametrize(
    ('topic', 'content', 'said'),
    [
        ('/guidance/decision', None, 'no topic /guidance/decision'),
        ('/guidance/decision', (STATUS, []), 'no decision in /guidance/decision'),
        ('/sim/truth', (ODOMETRY, [at(8, 1.0, 0.0, 1.0)]), 'found 1 messages in /sim/truth'),
        ('/sim/wheel_speeds', None, 'no topic /sim/wheel_speeds'),
        ('/sim/truth', (JOINTS, [joints(8, ())]), 'JointState in /sim/truth, wanted nav'),
        ('/guidance/predicted_path', (JOINTS, [joints(8, ())]), 'predicted_path, wanted nav'),
    ],
)
def test_a_run_that_lacks_something_is_refused_by_its_name(tmp_path, topic, content, said):
    there = {**topics(), topic: content}
    there = {name: each for name, each in there.items() if each is not None}
    bag = write(tmp_path / 'bag', there)
    with pytest.raises(BagError, match=said):
        read_run(bag)


def test_decisions_of_another_program_are_refused_as_such(tmp_path):
    foreign = status()
    bag = write(tmp_path / 'bag', {**topics(), '/guidance/decision': (STATUS, [foreign])})
    with pytest.raises(BagError, match='/guidance/decision'):
        read_run(bag)


def test_what_own_sensors_no_longer_see_is_forgotten_by_their_next_sighting():
    settings = guidance_settings(TABLE.resolve(load_parameter_file('case3')))
    told = Track(7, 0, 0.3, 1.0, 0.0, 0.5, 0.0)
    seen = replace(told, id=Track.SEEN + 7, position_stddev=0.1, velocity_stddev=0.2)
    (one, other) = seen_at([told, seen], SECOND // 4, settings)
    assert (one.x, other.x) == (1.125, 1.125)
    assert (one.position_stddev, other.position_stddev) == pytest.approx((0.0, 0.15))
    assert [each.id for each in seen_at([told, seen], SECOND // 2, settings)] == [7]
    assert seen_at([told, seen], 2 * SECOND, settings) == []
    assert (told.name, seen.name) == ('moving obstacle 7', 'person 7')
    assert replace(told, id=3 * Track.SEEN + 4).name == 'object 4 of tracker 2'
