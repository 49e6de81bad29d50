"""Replay: the same decisions from the same odometry, or the first that is another."""

import math
import struct
from functools import partial

import numpy as np
import pytest
from bag_messages import SECOND, odometry
from recorded_drives import DECISIONS, TICK, altered, dropping, editing, moving, said, setting

from cmpsp_ros.bags import Bag, BagError, Names
from cmpsp_ros.bags.decision_record import status_of
from cmpsp_ros.bags.replay.replay import replay
from cmpsp_ros.parameters import guidance_settings

NAMES = Names.under('')
PLAN = '/guidance/predicted_path'


def bits(number):
    return struct.unpack('<q', struct.pack('<d', number))[0]


def next_double(text):
    return repr(math.nextafter(float(text), math.inf))


def identical(bag):
    outcome = replay(bag, NAMES)
    assert (outcome.differences, outcome.first) == (0, None), outcome.first
    return outcome


def test_a_run_with_every_fault_is_identical(faulty):
    bag, decisions = faulty
    assert {each.level.name for each in decisions} >= {'NOMINAL', 'STOP'}
    assert len({each.run for each in decisions}) == 2
    assert [each.revision for each in decisions][-1] == 3
    outcome = identical(bag)
    assert outcome.decisions == outcome.commands == len(decisions)
    assert outcome.stops == sum(each.halted for each in decisions) == 6
    assert outcome.plans == sum(each.plan is not None for each in decisions) > 20
    assert outcome.skipped == 0


def aside(pose, by):
    return np.add(pose, [0.0, by, 0.0])


def test_a_ghost_of_the_robot_is_replayed_as_it_was(drive, bag):
    with drive(**{'robot.max_wheel_acceleration': 100.0}) as run:
        run.go(2.0)
        for _ in range(30):
            run.hear(run.now)
            run.hear(run.now + TICK // 2, aside(run.pose, 10.0))
            run.tick()
        run.go(1.0)
    stops = [each for each in run.decisions if each.halted]
    assert any('jumps by 10 m' in each.reason for each in stops)
    # It brakes to rest, and no wheel changes by more than the limit in a control period.
    assert stops[0].wheel_speeds.any()
    assert not stops[-1].wheel_speeds.any()
    wheels = np.array([each.wheel_speeds for each in run.decisions])
    assert np.abs(np.diff(wheels, axis=0)).max() <= 100.0 * 0.2 + 1e-6
    assert run.decisions[-1].twist[0] > 0.5
    assert identical(bag).stops == len(stops)


def test_of_two_messages_of_one_instant_the_one_that_was_followed_is_found(drive, bag):
    with drive() as run:
        run.go(1.0)
        for _ in range(20):
            # The recorder heard another source before the node did.
            for late in (0, TICK // 2):
                run.say(odometry(run.now + late, aside(run.pose, 10.0)))
            run.hear(run.now)
            run.tick()
        run.go(0.5)
    assert not any(each.halted for each in run.decisions)
    identical(bag)


def test_old_odometry_that_was_ignored_begins_no_run(drive, bag):
    with drive() as run:
        run.go(0.5)
        run.hear(run.now - 100 * SECOND, aside(run.pose, 10.0))
        run.go(0.5)
    assert {each.run for each in run.decisions} == {run.decisions[0].run}
    identical(bag)


def test_what_no_plan_can_do_is_foretold_again(drive, bag):
    with drive(final_time=5.0) as run:
        run.go(0.5)
    first, second = run.decisions[:2]
    assert 'The goal is out of reach by ' in first.reason
    assert 'out of reach' not in second.reason
    identical(bag)


def test_a_lag_is_estimated_again(drive, bag):
    with drive(max_wheel_lag=0.3) as run:
        run.go(2.0)
        run.halt()
        run.go(1.0)
    assert run.decisions[0].wheel_lag == (0.0, 0.0, 0.3)
    assert run.decisions[-1].wheel_lag[2] < 0.3
    identical(bag)


@pytest.mark.parametrize('seconds', [0.26, 0.8])
def test_a_computer_that_is_late_is_replayed_as_it_was(drive, bag, seconds):
    with drive() as run:
        run.go(1.0)
        for _ in range(3):
            run.be_late(seconds)
            run.go(0.5)
        run.skip(0.5)
        run.go(0.5)
    late = [each for each in run.decisions if each.late]
    assert len(late) == 3
    assert sum(each.reason.startswith('The computer was late') for each in run.decisions) == 3
    outcome = identical(bag)
    assert (outcome.decisions, outcome.commands) == (len(run.decisions), len(run.decisions) - 3)


def test_a_run_by_poses_of_another_frame_is_replayed_without_transforms(drive, bag, alter):
    with drive() as run:
        run.publish = partial(publish_with_pose, run, run.publish)
        run.go(2.0)

    def elsewhere(topic, _index, message):
        if topic == '/odom':
            message.header.frame_id = 'drifting'
            message.pose.pose.position.x += 3.0
        return message

    for path in (bag, alter(elsewhere)):
        assert identical(path).decisions == len(run.decisions) == 10


def publish_with_pose(run, publish, decision):
    publish(decision._replace(pose=tuple(run.measured().tolist())))


KEYS = (
    'wheel_speed_right',
    'wheel_speed_left',
    'terminal_error',
    'clearance',
    'worst_clearance',
    'time_left',
)


@pytest.mark.parametrize('key', KEYS)
def test_the_last_bit_of_every_number_of_a_decision_counts(short, replayed, key):
    folder, decisions = short
    with Bag(folder) as recorded:
        _, message = list(recorded.messages(DECISIONS))[1]
    before = said(message, key).value
    change = setting(1, **{key: next_double(before)})
    outcome = replayed(change)
    assert (outcome.differences, outcome.differing) == (1, 1)
    first = outcome.first
    assert (first.number, first.field, first.recorded) == (2, key, next_double(before))
    assert first.stamp == decisions[1].stamp
    assert bits(float(first.replayed)) == bits(float(before))
    assert replayed(change, 1e-12).differences == 0


@pytest.mark.parametrize(
    ('key', 'value'),
    [
        *(('fallback_level', 'elastic'), ('iterations', '3'), ('qp_iterations', '1000')),
        *(('active_rows', '1000'), ('failures', '1'), ('step', '7'), ('slack', '0.1')),
        ('finished', 'true'),
    ],
)
@pytest.mark.parametrize('tolerance', [None, 1e-6])
def test_every_other_fact_counts_with_and_without_tolerance(replayed, key, value, tolerance):
    first = replayed(setting(1, **{key: value}), tolerance).first
    assert (first.field, first.number) == (key, 2)


@pytest.mark.parametrize(
    ('change', 'number', 'field', 'differing'),
    [
        (editing('/cmd_vel', moving('angular.z', 1e-9), 2), 3, 'command.angular.z', 1),
        (editing(PLAN, moving('poses.5.pose.position.y', 1e-9), 1), 2, 'plan.poses[5].y', 1),
        (editing('/odom', moving('pose.pose.position.x', 1e-6), 10), 2, None, 2),
        # Not one of those that a decision answers.
        (editing('/odom', moving('pose.pose.position.x', 1.0), 11), None, None, 0),
        (dropping('/odom', 10), 2, 'decision', None),
        (dropping(DECISIONS, 1), None, 'decision', None),
        (editing('/odom', moving('pose.pose.position.x', 1e300), 0), 1, None, None),
    ],
    ids=['command', 'plan', 'odometry', 'unused', 'no odometry', 'no decision', 'far away'],
)
def test_what_is_another_is_caught_where_it_is(replayed, change, number, field, differing):
    with np.errstate(all='ignore'):
        outcome = replayed(change)
    assert outcome.differing > 0 if differing is None else outcome.differing == differing
    if outcome.first is not None:
        assert outcome.first.field == (field or outcome.first.field)
        assert outcome.first.number == (number or outcome.first.number)


def test_a_node_that_decides_no_more_is_caught_where_the_next_decision_is_due(drive, alter):
    with drive() as run:
        run.go(3.0)
    outcome = replay(alter(dropping(DECISIONS, *range(5, 15))), NAMES)
    assert (outcome.decisions, outcome.differing, outcome.differences) == (5, 0, 0)
    first = outcome.first
    assert (first.number, first.stamp) == (6, run.decisions[5].stamp)
    assert (first.field, first.replayed) == ('decision', 'one is due')
    assert 'in 0 of 5 decisions, and decisions that were due are missing;' in str(outcome)


def test_a_recording_that_ends_before_a_decision_is_not_taken_for_a_node_that_stops(drive, alter):
    with drive() as run:
        run.go(2.0)
    outcome = replay(alter(dropping(DECISIONS, *range(6, 10))), NAMES)
    assert (outcome.decisions, outcome.first, outcome.unjudged) == (6, None, 0.0)


@pytest.mark.parametrize('ending', ['stop', 'end of the run'])
def test_after_a_stop_and_after_the_end_no_decision_is_missed(drive, bag, ending):
    with drive(final_time=3.0) as run:
        run.go(1.0 if ending == 'stop' else 3.1)
        if ending == 'stop':
            run.halt('The node was deactivated.')
        for _ in range(150):
            run.say(odometry(run.now, run.pose))
            run.tick()
    outcome = replay(bag, NAMES)
    assert (outcome.decisions, outcome.first) == (len(run.decisions), None)
    said = 's of odometry after the last decision: another may have been due'
    assert (outcome.unjudged > 1.5) is (said in str(outcome)) is (ending == 'stop')


def test_a_wrong_sentence_is_caught_and_within_tolerance_only_its_words_count(drive, alter):
    with drive() as run:
        run.pose = np.array([0.0, -11.5, 0.0])
        run.go(0.5)

    def reword(message):
        status = status_of(message)
        status.message = status.message.replace(number, f'{number}1')
        return message

    number = next(word for word in run.decisions[0].reason.split() if word[0].isdigit())
    copy = alter(editing(DECISIONS, reword))
    assert replay(copy, NAMES).first.field == 'reason'
    assert replay(copy, NAMES, 1e-6).differences == 0


@pytest.mark.parametrize('place', [0, 3])
def test_each_speed_of_four_wheels_counts_within_tolerance(drive, bag, alter, place):
    with drive(preset='omni_aisle') as run:
        run.pose = np.zeros(3)
        run.go(0.5)

    def other(by):
        def edit(message):
            entry = said(message, 'wheel_speeds')
            speeds = entry.value.split(' ')
            assert len(speeds) == 4
            speeds[place] = repr(float(speeds[place]) + by)
            entry.value = ' '.join(speeds)
            return message

        return editing(DECISIONS, edit, 1)

    outcome = replay(alter(other(1.0)), NAMES, 1e-9)
    assert (outcome.differing, outcome.first.field) == (1, 'wheel_speeds')
    near = altered(bag, bag.with_name('near'), other(1e-12))
    assert replay(near, NAMES).differing == 1
    verdict = str(replay(near, NAMES, 1e-9))
    assert verdict.startswith('within 1e-09, but for numbers in reasons: 3 decisions\n')


def test_a_robot_in_a_namespace(drive, bag):
    with drive(prefix='/r1') as run:
        run.go(0.5)
    outcome = replay(bag, Names.under('/r1'))
    assert (outcome.decisions, outcome.differences) == (3, 0)
    with pytest.raises(BagError, match=r'no parameters of /guidance; there are those of /r1'):
        replay(bag, NAMES)


def restarted(drive, bag, **changed):
    """A run in which a node is started anew with other parameters."""
    with drive() as run:
        run.go(0.7)
        run.change(weights__road_center=20.0)
        run.go(0.3)
        run.halt('The guidance node is shutting down.')
        run.now += 2_000_000_000
        run.values = {**run.values, **changed}
        run.publish_parameters()
        run.settings = guidance_settings(run.values)
        run.law = type(run.law)(run.settings, run.settings.world)
        run.activate()
        run.go(0.7)
        run.change(weights__road_center=30.0)
        run.go(0.7)
    return run


def test_a_node_that_was_started_again_is_another_law(drive, bag):
    run = restarted(drive, bag)
    assert {each.revision for each in run.decisions} == {0, 1}
    assert replay(bag, NAMES).differences == 0


def test_a_node_that_was_started_again_with_other_parameters(drive, bag, alter):
    changed = {'weights.road_center': 5.0, 'robot.max_wheel_speed': 49.0}
    run = restarted(drive, bag, **changed)
    outcome = replay(bag, NAMES)
    assert (outcome.decisions, outcome.differences) == (len(run.decisions), 0)
    assert replay(alter(dropping('/guidance/parameters', 1)), NAMES).differences > 0


def test_time_that_jumps_back_begins_a_run(drive, bag):
    with drive() as run:
        run.go(0.7)
        run.behind = 2_000_000_000
        run.go(0.7)
    assert [each.step for each in run.decisions] == [0, 1, 2, 3, 0, 1, 2, 3]
    assert replay(bag, NAMES).differences == 0


def test_a_recording_that_begins_in_the_middle_waits_for_the_next_run(drive, alter):
    with drive() as run:
        run.go(1.0)
        run.activate()
        run.pose = np.array([0.0, -9.25, 0.0])
        run.go(1.0)

    outcome = replay(alter(dropping(DECISIONS, 0, 1)), NAMES)
    assert (outcome.skipped, outcome.decisions) == (3, len(run.decisions) - 5)
    assert outcome.differences == 0
    assert 'left out: 3 decisions' in str(outcome)
