"""Replay with another law on the same odometry, in a bag and a picture of its own."""

import re

import pytest
from commands import command

from cmpsp_ros.bags import Bag, Names
from cmpsp_ros.bags.audit import Sources, read_record
from cmpsp_ros.bags.decision_record import status_of
from cmpsp_ros.bags.replay import Change, draw_what_if, what_if
from cmpsp_ros.bags.replay.replay import replay
from cmpsp_ros.parameters import ParameterError, load_parameter_file

NAMES = Names.under('')
WEIGHT = Change(None, {'weights.road_center': 30.0})


def said(bag, topic):
    with Bag(bag) as opened:
        messages = [message for _, message in opened.messages(topic)]
    return [{each.key: each.value for each in status_of(message).values} for message in messages]


def test_nothing_changed_is_what_was_recorded(faulty, tmp_path):
    bag, decisions = faulty
    result = what_if(bag, NAMES, Change(None, {}), tmp_path / 'new')
    assert len(result.decisions) == len(result.recorded) == len(decisions)
    before = said(tmp_path / 'new', '/guidance/decision')
    after = said(tmp_path / 'new', '/what_if/guidance/decision')
    for one, other in zip(before, after, strict=True):
        told = {'run', 'revision'}
        assert {k: v for k, v in one.items() if k not in told} == {
            k: v for k, v in other.items() if k not in told
        }


def test_a_changed_law_is_beside_the_recorded_one_in_a_new_bag(faulty, tmp_path):
    bag, decisions = faulty
    result = what_if(bag, NAMES, WEIGHT, tmp_path / 'new')
    with Bag(bag) as old, Bag(tmp_path / 'new') as new:
        for topic in old.topics:
            assert list(new.raw(topic)) == list(old.raw(topic))
        assert new.parameters['/guidance'] == old.parameters['/guidance']
        assert new.parameters['/what_if/guidance']['weights.road_center'] == 30.0
        twists = [(each.linear.x, each.angular.z) for _, each in new.messages('/what_if/cmd_vel')]
        stamps = [stamp for stamp, _ in new.raw('/what_if/guidance/decision')]
        plans = new.topics['/what_if/guidance/predicted_path'].count
    assert twists == [tuple(each.twist.tolist()) for _, each in result.decisions]
    assert twists != [tuple(each.twist.tolist()) for each in decisions]
    assert stamps == [received for received, _ in result.decisions] == sorted(stamps)
    assert plans == sum(each.plan is not None for _, each in result.decisions) > 0
    # What was recorded can still be replayed from it.
    assert replay(tmp_path / 'new', NAMES).differences == 0
    recorded, changed = str(result).splitlines()
    assert re.match(rf'recorded: {len(decisions)} decisions, .* stop', recorded)
    assert changed.startswith('changed: ')
    draw_what_if(result, 'weights.road_center=30', tmp_path / 'it.png')
    assert (tmp_path / 'it.png').read_bytes()[:8] == b'\x89PNG\r\n\x1a\n'
    assert (tmp_path / 'it.png').stat().st_size > 20_000


def test_a_live_change_does_not_undo_what_was_asked_for(faulty, tmp_path):
    bag, _ = faulty
    # The recording sets this weight under way.
    result = what_if(bag, NAMES, WEIGHT, tmp_path / 'new')
    always = {**load_parameter_file('case3'), 'weights.road_center': 30.0}
    again = what_if(bag, NAMES, Change(always, {}), tmp_path / 'again')
    before = [each for _, each in result.decisions if each.revision == 0]
    after = [each for _, each in again.decisions if each.revision == 0]
    assert [each.twist.tolist() for each in before] == [each.twist.tolist() for each in after]


def test_a_parameter_that_is_fixed_while_a_node_runs_may_change(drive, bag, tmp_path):
    with drive() as run:
        run.go(1.0)
    result = what_if(bag, NAMES, Change(None, {'control_period': 0.1}), tmp_path / 'new')
    assert (len(result.recorded), len(result.decisions)) == (5, 9)


@pytest.mark.parametrize('changes', [{'weights.roadcenter': 1.0}, {'goal.position': [0.0, 0.0]}])
def test_parameters_that_cannot_be_used_leave_nothing_behind(faulty, tmp_path, changes):
    bag, _ = faulty
    with pytest.raises(ParameterError, match=next(iter(changes))):
        what_if(bag, NAMES, Change(None, changes), tmp_path / 'new')
    assert not (tmp_path / 'new').exists()


def wrong(topic, index, message):
    if topic == '/cmd_vel' and index == 1:
        message.linear.x += 0.5
    return message


def test_identical_is_exit_code_0(faulty):
    bag, decisions = faulty
    result = command('replay', bag)
    assert result.exit_code == 0, result.output
    assert result.stdout.startswith(f'identical: {len(decisions)} decisions\n')


def test_a_difference_is_exit_code_1_and_named(drive, alter):
    with drive() as run:
        run.go(0.5)
    copy = alter(wrong)
    for options in ((), ('--tolerance', '1e-9')):
        result = command('replay', copy, *options)
        assert result.exit_code == 1
        assert 'decision 2 (stamp 1700000000200000007 ns): command.linear.x' in result.stdout
        assert re.search(r'linear\.x: recorded [\d.]+, replayed [\d.]+\n', result.stdout)
        assert 'different: 1 fields in 1 of 3 decisions' in result.stdout
    assert command('replay', copy, '--tolerance', '1').exit_code == 0


@pytest.mark.parametrize(
    ('arguments', 'reason'),
    [
        (['{}/bag', '--namespace', '/r1'], 'no parameters of /r1/guidance; there are those of'),
        (['{}/bag', '--odom', '/pose'], 'no topic /pose; there is /cmd_vel, /guidance/decision'),
        (['{}/bag', '--set', 'final_tim=1.0'], 'did you mean final_time?'),
        (['{}/bag', '--set', 'final_time'], 'no key=value'),
        (['{}/bag', '--params-file', 'case9'], 'no such preset'),
        (['{}/bag', '--tolerance', 'inf'], 'found inf, wanted a finite number >= 0'),
        (['{}/bag', '--tolerance', 'nan'], 'found nan, wanted a finite number >= 0'),
        (['{}/bag', '--tolerance=-1e-9'], 'found -1e-09, wanted a finite number >= 0'),
    ],
)
def test_what_cannot_be_used_is_exit_code_2_in_one_line(drive, tmp_path, arguments, reason):
    with drive() as run:
        run.go(0.5)
    result = command('replay', *(each.format(tmp_path) for each in arguments))
    assert result.exit_code == 2
    assert reason in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert result.stdout == ''
    assert not (tmp_path / 'bag_what_if').exists()


@pytest.mark.parametrize(
    'options', [['--set', 'weights.road_center=30'], ['--params-file', 'case2']]
)
def test_what_if_is_exit_code_0_with_a_bag_and_a_picture(drive, bag, options):
    with drive() as run:
        run.go(0.5)
    result = command('replay', bag, *options)
    assert result.exit_code == 0, result.output
    folder = bag.with_name('bag_what_if')
    assert {each.name for each in folder.iterdir()} == {'bag', 'what_if.png'}
    text = re.sub(r'\s+', ' ', result.stdout)
    assert 'recorded: 3 decisions, 3 nominal' in text
    assert 'the robot followed the recorded commands, not the changed ones' in text
    again = command('replay', bag, *options)
    assert again.exit_code == 2
    assert 'exists already' in again.stderr


def test_a_file_of_several_robots_gives_the_values_of_the_one_that_is_meant(drive, bag):
    with drive(prefix='/r2') as run:
        run.go(0.5)
    assert command('replay', bag, '--params-file', 'fleet', '--namespace', '/r2').exit_code == 0
    with Bag(bag.with_name('bag_what_if') / 'bag') as new:
        assert new.parameters['/what_if/r2/guidance']['goal.position'] == [-5.0, 0.0]
    audited = read_record(bag, Sources(params_file='fleet', namespace='/r2'))
    assert audited.history.epochs[0].values['goal.position'] == [-5.0, 0.0]


@pytest.mark.parametrize('verb', ['replay', 'audit'])
def test_a_file_of_several_robots_without_a_namespace_is_refused(drive, bag, verb):
    with drive() as run:
        run.go(0.5)
    done = command(verb, bag, '--params-file', 'fleet')
    assert done.exit_code == 2
    assert (
        'goal.position: found [5.0, 0.0] for /r1/** and [-5.0, 0.0] for /r2/**, wanted one value'
        ' for both, or the namespace of a robot' in done.stderr
    )
