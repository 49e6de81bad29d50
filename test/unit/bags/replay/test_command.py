"""`cmpsp replay` by its arguments, words and exit codes."""

import re

import pytest
from commands import command


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
