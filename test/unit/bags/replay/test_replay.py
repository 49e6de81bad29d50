"""Replay: the same decisions from the same odometry, or the first that is another."""

from __future__ import annotations

import math
import struct

import numpy as np
import pytest
from recorded_drives import DECISIONS, said, setting, without

from cmpsp_ros.bags.decision_record import status_of
from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.bags.replay.recording import Names
from cmpsp_ros.bags.replay.replay import replay
from cmpsp_ros.parameters.settings import guidance_settings

NAMES = Names.under('')


def bits(number):
    return struct.unpack('<q', struct.pack('<d', number))[0]


def next_double(text):
    return repr(math.nextafter(float(text), math.inf))


def test_a_run_with_every_fault_is_identical(faulty):
    bag, decisions = faulty
    assert {each.rung.name for each in decisions} >= {'NOMINAL', 'STOP'}
    assert len({each.run for each in decisions}) == 2
    assert [each.revision for each in decisions][-1] == 3
    outcome = replay(bag, NAMES)
    assert (outcome.differences, outcome.first) == (0, None), outcome.first
    assert outcome.decisions == outcome.commands == len(decisions)
    assert outcome.stops == sum(each.halted for each in decisions) == 4
    assert outcome.plans == sum(each.plan is not None for each in decisions) > 20
    assert outcome.skipped == 0


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
    outcome = replay(bag, NAMES)
    assert (outcome.differences, outcome.first) == (0, None), outcome.first
    assert (outcome.decisions, outcome.commands) == (len(run.decisions), len(run.decisions) - 3)


def test_two_replays_are_one(faulty):
    bag, _ = faulty
    assert replay(bag, NAMES) == replay(bag, NAMES)


def test_the_last_bit_of_every_number_of_a_decision_counts(drive, alter, bag):
    with drive() as run:
        run.go(0.5)
    keys = ('wheel_speed_right', 'wheel_speed_left', 'miss', 'margin', 'worst_margin', 'time_left')
    for key in keys:
        with Bag(bag) as recorded:
            _, message = list(recorded.messages(DECISIONS))[1]
        value = next_double(said(message, key).value)
        copy = alter(setting(1, **{key: value}))
        outcome = replay(copy, NAMES)
        assert (outcome.differences, outcome.differing) == (1, 1)
        first = outcome.first
        assert (first.number, first.field, first.recorded) == (2, key, value)
        assert first.stamp == run.decisions[1].stamp
        assert bits(float(first.replayed)) == bits(float(said(message, key).value))
        assert replay(copy, NAMES, 1e-12).differences == 0
        for each in sorted(copy.rglob('*'), reverse=True):
            each.unlink()
        copy.rmdir()


@pytest.mark.parametrize(
    'facts',
    [
        {'rung': 'elastic'},
        {'iterations': '3'},
        {'qp_iterations': '1000'},
        {'active_rows': '1000'},
        {'failures': '1'},
        {'step': '7'},
        {'slack': '0.1'},
        {'finished': 'true'},
    ],
    ids=lambda facts: next(iter(facts)),
)
@pytest.mark.parametrize('tolerance', [None, 1e-6])
def test_every_other_fact_counts_with_and_without_tolerance(drive, alter, facts, tolerance):
    with drive() as run:
        run.go(0.5)
    outcome = replay(alter(setting(1, **facts)), NAMES, tolerance)
    assert outcome.first.field == next(iter(facts))
    assert outcome.first.number == 2


def test_a_wrong_command_is_caught(drive, alter):
    with drive() as run:
        run.go(0.5)

    def change(topic, index, message):
        if topic == '/cmd_vel' and index == 2:
            message.angular.z += 1e-9
        return message

    outcome = replay(alter(change), NAMES)
    assert (outcome.first.number, outcome.first.field) == (3, 'command.angular.z')
    assert outcome.differences == 1


def test_a_wrong_plan_is_caught(drive, alter):
    with drive() as run:
        run.go(0.5)

    def change(topic, index, message):
        if topic == '/guidance/predicted_path' and index == 1:
            message.poses[5].pose.position.y += 1e-9
        return message

    outcome = replay(alter(change), NAMES)
    assert (outcome.first.number, outcome.first.field) == (2, 'plan.poses[5].y')
    assert outcome.differences == 1


def test_a_wrong_sentence_is_caught_and_within_tolerance_only_its_words_count(drive, alter):
    with drive() as run:
        run.pose = np.array([0.0, -11.5, 0.0])
        run.go(0.5)

    def reword(old, new):
        def change(topic, _index, message):
            if topic == DECISIONS:
                status = status_of(message)
                status.message = status.message.replace(old, new)
            return message

        return change

    reason = run.decisions[0].reason
    assert any(character.isdigit() for character in reason)
    number = next(word for word in reason.split() if word[0].isdigit())
    copy = alter(reword(number, f'{number}1'))
    assert replay(copy, NAMES).first.field == 'reason'
    assert replay(copy, NAMES, 1e-6).differences == 0


def test_a_decision_taken_out_is_missed_and_the_rest_still_compared(drive, alter):
    with drive() as run:
        run.go(1.0)

    def change(topic, index, message):
        return None if topic == DECISIONS and index == 2 else message

    outcome = replay(alter(change), NAMES)
    assert (outcome.first.field, outcome.first.recorded) == ('decision', 'nothing')
    assert outcome.first.stamp == run.decisions[2].stamp


def test_other_odometry_makes_other_decisions(drive, alter):
    with drive() as run:
        run.go(0.5)

    def change(topic, index, message):
        if topic == '/odom' and index == 10:
            message.pose.pose.position.x += 1e-6
        return message

    outcome = replay(alter(change), NAMES)
    assert outcome.first.number == 2
    assert outcome.differing == 2


def test_odometry_between_two_decisions_does_not_matter(drive, alter):
    with drive() as run:
        run.go(0.5)

    def change(topic, index, message):
        if topic == '/odom' and index == 11:
            message.pose.pose.position.x += 1.0
        return message

    assert replay(alter(change), NAMES).differences == 0


def test_a_decision_without_its_odometry_is_a_difference(drive, alter):
    with drive() as run:
        run.go(0.5)

    def change(topic, index, message):
        return None if topic == '/odom' and index == 10 else message

    outcome = replay(alter(change), NAMES)
    assert outcome.first.number == 2
    assert 'not in the bag' in outcome.first.replayed


def test_a_robot_in_a_namespace(drive, bag):
    with drive(prefix='/r1') as run:
        run.go(0.5)
    outcome = replay(bag, Names.under('/r1'))
    assert (outcome.decisions, outcome.differences) == (3, 0)
    with pytest.raises(BagError, match=r'no parameters of /guidance; there are those of /r1'):
        replay(bag, NAMES)


def test_a_node_that_was_started_again_is_another_law(drive, bag):
    with drive() as run:
        run.go(0.7)
        run.change(weights__road_center=20.0)
        run.go(0.7)
        run.halt('The guidance node is shutting down.')
        run.law = type(run.law)(run.settings)
        run.activate()
        run.go(0.7)
    assert [each.revision for each in run.decisions][-1] == 0
    assert replay(bag, NAMES).differences == 0


def restarted(drive, bag, **changed):
    """A bag in which a node is started anew with other parameters; and when it was [ns]."""
    with drive() as run:
        run.go(0.7)
        run.change(weights__road_center=20.0)
        run.go(0.3)
        run.halt('The guidance node is shutting down.')
        since = run.now
        run.now += 2_000_000_000
        run.values = {**run.values, **changed}
        run.settings = guidance_settings(run.values)
        run.law = type(run.law)(run.settings)
        run.activate()
        run.go(0.7)
        run.change(weights__road_center=30.0)
        run.go(0.7)
    return run, since


def test_a_node_that_was_started_again_with_other_parameters(drive, bag, alter):
    changed = {'weights.road_center': 5.0, 'robot.max_wheel_speed': 49.0}
    run, since = restarted(drive, bag, **changed)
    assert replay(bag, NAMES).differences > 0
    with Bag(bag) as there:
        again = {**there.parameters['/guidance'], **changed}
    outcome = replay(alter(restarts={'/guidance': [(since, again)]}), NAMES)
    assert (outcome.decisions, outcome.differences) == (len(run.decisions), 0)


@pytest.mark.parametrize('told', [(), ('halted', 'run', 'revision')], ids=['told', 'untold'])
def test_time_that_jumps_back_begins_a_run(drive, alter, told):
    with drive() as run:
        run.go(0.7)
        run.behind = 2_000_000_000
        run.go(0.7)
    assert [each.step for each in run.decisions] == [0, 1, 2, 3, 0, 1, 2, 3]
    assert replay(alter(without(*told)), NAMES).differences == 0


def test_a_recording_that_begins_in_the_middle_waits_for_the_next_run(drive, alter):
    with drive() as run:
        run.go(1.0)
        run.activate()
        run.pose = np.array([0.0, -9.25, 0.0])
        run.go(1.0)

    def late(topic, index, message):
        return None if topic == DECISIONS and index < 2 else message

    outcome = replay(alter(late), NAMES)
    assert (outcome.skipped, outcome.decisions) == (3, len(run.decisions) - 5)
    assert outcome.differences == 0
    assert 'left out: 3 decisions' in str(outcome)


def test_a_bag_of_a_version_that_did_not_say_what_the_law_was_told(drive, alter):
    with drive() as run:
        run.go(0.7)
        run.halt()
        run.go(0.7)
        run.activate()
        run.go(0.7)
    outcome = replay(alter(without('halted', 'run', 'revision')), NAMES)
    assert (outcome.differences, outcome.stops) == (0, 1)
    assert outcome.decisions == len(run.decisions)


def test_a_robot_beyond_all_bounds_is_a_difference_and_no_crash(drive, alter):
    with drive() as run:
        run.go(0.5)

    def change(topic, index, message):
        if topic == '/odom' and index == 0:
            message.pose.pose.position.x = 1e300
        return message

    with np.errstate(all='ignore'):
        assert replay(alter(change), NAMES).first.number == 1


def test_what_is_said_of_it(drive, alter, bag):
    with drive() as run:
        run.go(0.5)
    assert str(replay(bag, NAMES)).splitlines()[0] == 'identical: 3 decisions'
    said_of_it = str(replay(alter(setting(1, margin='0.5')), NAMES))
    assert 'decision 2 (stamp' in said_of_it
    assert 'margin: recorded 0.5, replayed ' in said_of_it
    assert 'different: 1 fields in 1 of 3 decisions' in said_of_it
