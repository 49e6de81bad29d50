"""Parameters of hidden robots, from bags of their drives."""

import math
from collections import Counter
from dataclasses import replace
from pathlib import Path

import pytest
from bag_messages import SECOND
from hidden_robots import START, Hidden, commands_of, drawn, record, truth_of

from cmpsp_ros.bags import BagError
from cmpsp_ros.bags.identify import Sources, identify, write_parameters
from cmpsp_ros.demo import load_scenario
from cmpsp_ros.parameters.files import load_robot

RECORDED = Path(__file__).parents[1] / 'recorded'
RESPONSE = 'delay', 'lag', 'together', 'command_delay', 'linear_scale', 'angular_scale'


def check(found, hidden):
    """Estimates whose interval does not have the true value; the sum is within 10 ms."""
    missed = []
    for key, (low, high) in truth_of(hidden).items():
        interval = found.estimates[key].interval
        assert interval is not None, found.estimates[key].remark
        # Stamps are in whole nanoseconds.
        if interval.low > high * (1.0 + 1e-6) or interval.high < low * (1.0 - 1e-6):
            missed.append(f'{key}: {interval}, truly {low:.5g} to {high:.5g}')
    together = found.estimates['together'].interval.value
    assert together == pytest.approx(hidden.delay + hidden.clock + hidden.lag, abs=0.01)
    return missed


@pytest.mark.timeout(600)
def test_of_50_hidden_robots_95_percent_of_each_parameter_are_in_their_intervals(tmp_path):
    missed = Counter()
    for seed in range(100, 150):
        hidden = drawn(seed)
        found = identify([record(tmp_path / f'{seed}', hidden)])
        missed.update(each.partition(':')[0] for each in check(found, hidden))
    assert max(missed.values(), default=0) <= 2, missed


def test_limits_that_were_reached_are_found_and_others_are_said_not_to_be(tmp_path):
    straight = [(at, speed, 0.0) for at, speed, _ in commands_of(Hidden())]
    found = identify([record(tmp_path / 'bag', Hidden(max_speed=0.2), straight)]).estimates
    speed = found['linear_speed'].interval
    assert speed.low < 0.2 < speed.high < 0.21
    assert found['linear_acceleration'].interval is None
    assert 'not identifiable: not reached, up to 2.8' in found['linear_acceleration'].remark
    assert found['linear_scale'].interval.low < 1.0 < found['linear_scale'].interval.high
    assert found['angular_scale'].remark == 'not identifiable: there was no angular command'


def test_clocks_that_differ_shift_delay_and_age_but_not_the_parameter(tmp_path):
    hidden = Hidden(clock=0.25)
    found = identify([record(tmp_path / 'bag', hidden)]).estimates
    assert found['age'].interval.high < 0.0
    assert 'clock of the robot is ahead by 2' in found['age'].remark
    assert found['delay'].interval.low < 0.35 < found['delay'].interval.high
    assert found['command_delay'].interval.value == pytest.approx(0.212, abs=0.005)


def test_a_robot_that_stops_by_itself_between_commands_is_told_from_a_slow_one(tmp_path):
    commands = [each for each in commands_of(Hidden()) if (each[0] - START) // SECOND % 3 != 1]
    hidden = Hidden()
    found = identify([record(tmp_path / 'bag', hidden, commands)])
    assert found.estimates['timeout'].interval.value == 0.5
    assert check(found, hidden) == []


COMMANDS = commands_of(Hidden())
BROKEN = [(at + 1_000_000, math.nan, 0.0) for at, _, _ in COMMANDS[::40]]
LATER = [each for each in COMMANDS if each[0] > START + 2 * SECOND]


@pytest.mark.parametrize(
    ('commands', 'options'),
    [(sorted([*COMMANDS, *BROKEN]), {'jump': (0.3, -0.2)}), (LATER, {'moving': True})],
    ids=['odometry jumps and commands are NaN', 'it begins on the move'],
)
def test_what_does_not_disturb_the_estimates(tmp_path, commands, options):
    bag = record(tmp_path / 'bag', Hidden(), commands, **options)
    assert check(identify([bag]), Hidden()) == []


@pytest.mark.slow
def test_several_bags_of_one_robot_are_one_identification(tmp_path):
    hidden = Hidden(noise=(0.004, 0.004))
    bags = [record(tmp_path / f'{seed}', replace(hidden, seed=seed)) for seed in (1, 2)]
    one, both = identify(bags[:1]), identify(bags)
    assert len(both.drives) == 2
    widths = [each.estimates['together'].interval for each in (one, both)]
    assert widths[1].high - widths[1].low < widths[0].high - widths[0].low
    assert check(both, hidden) == []


def test_decisions_say_what_a_command_answers(tmp_path):
    found = identify([RECORDED / 'case3'])
    assert found.drives[0].answer == pytest.approx(0.0, abs=1e-3)
    delay = found.estimates['command_delay']
    # In lockstep nothing is late, and the robot obeys at once.
    assert delay.interval.low <= 0.0 <= delay.interval.high
    assert 'control step' not in delay.remark
    assert found.nominal['robot.wheel_radius'] == 0.035


def test_stamps_of_commands_say_what_they_answer(tmp_path):
    # Each command is 50 ms later than the odometry that it has the stamp of.
    hidden = Hidden(rate=20.0, stamped=True, clock=-0.05)
    found = identify([record(tmp_path / 'bag', hidden, answering=True)]).estimates
    assert found['command_delay'].interval.value == pytest.approx(0.25, abs=0.005)
    assert 'control step' not in found['command_delay'].remark


def constant(speed, turn):
    return [(each[0], speed, turn) for each in commands_of(Hidden())]


def test_without_excitation_nothing_is_said_of_the_response(tmp_path):
    still = identify([record(tmp_path / 'still', Hidden(), constant(0.0, 0.0))]).estimates
    for key in RESPONSE:
        assert still[key].interval is None
        assert 'not identifiable: ' in still[key].remark
    assert 'the commands were 0 throughout' in still['delay'].remark
    assert still['rate'].interval.value == pytest.approx(30.0, rel=1e-6)


def test_a_steady_drive_says_the_scale_alone(tmp_path):
    bag = record(tmp_path / 'bag', Hidden(scales=(0.9, 1.0)), constant(0.2, 0.0), moving=True)
    found = identify([bag]).estimates
    assert found['delay'].remark == 'not identifiable: the commands never changed'


def test_a_robot_that_stands_still_is_not_identified(tmp_path):
    bag = record(tmp_path / 'bag', Hidden(scales=(0.0, 0.0)))
    found = identify([bag]).estimates
    assert 'the robot did not follow the commands' in found['lag'].remark


def test_the_parameter_file_is_a_robot_for_the_demo(tmp_path):
    hidden = Hidden(scales=(0.9, 1.1), stamped=True, max_speed=0.2)
    found = identify([record(tmp_path / 'bag', hidden)], robot='turtlebot4')
    path = tmp_path / 'robot.yaml'
    write_parameters(path, found)
    given = load_robot(str(path))
    radius = 0.03575 * 0.9
    assert given['command_delay'] == pytest.approx(0.212, abs=0.005)
    assert given['robot.wheel_radius'] == pytest.approx(radius, rel=0.05)
    assert given['robot.half_track'] == pytest.approx(0.1165 * 0.9 / 1.1, rel=0.05)
    assert given['robot.max_wheel_speed'] == pytest.approx(0.2 / radius, rel=0.05)
    assert given['enable_stamped_cmd_vel'] is True
    scenario = load_scenario('case3', [], lockstep=True, robot=str(path))
    assert scenario.values['command_delay'] == given['command_delay']
    text = path.read_text(encoding='utf-8')
    assert '    # max_wheel_lag: 0.1' in text
    assert f'{tmp_path / "bag"}: /odom, /cmd_vel' in text


def test_what_is_unknown_is_a_comment_in_the_file(tmp_path):
    found = identify([record(tmp_path / 'bag', Hidden(), constant(0.0, 0.0))])
    write_parameters(tmp_path / 'robot.yaml', found)
    assert load_robot(str(tmp_path / 'robot.yaml')) == {
        'initial_guess.type': 'road',
        'enable_stamped_cmd_vel': False,
    }
    assert 'not identifiable' in (tmp_path / 'robot.yaml').read_text(encoding='utf-8')


SHORT = [(START, 0.1, 0.0)]


@pytest.mark.parametrize(
    ('names', 'commands', 'sources', 'message'),
    [
        (('/odom', '/cmd_vel'), SHORT, Sources(), r'found 3\.. s of /odom and 1 commands of'),
        (
            ('/odom', '/cmd_vel'),
            None,
            Sources('/wheels'),
            r'Odometry in /wheels, .* /odom \(--odom',
        ),
        (
            ('/odom', '/cmd_vel'),
            None,
            Sources(None, '/c'),
            r'in /c, wanted one of /cmd_vel \(--cmd',
        ),
        (('/r1/odom', '/r1/cmd_vel'), None, Sources(namespace='/r2'), ''),
        (('/odom', ''), None, Sources(), r'found no geometry_msgs/msg/Twist or .* in any topic'),
    ],
)
def test_a_bag_that_cannot_be_used_is_refused(tmp_path, names, commands, sources, message):
    bag = record(tmp_path / 'bag', Hidden(), commands, names)
    if message:
        with pytest.raises(BagError, match=message):
            identify([bag], sources)
    else:
        assert identify([bag], sources).drives


def test_several_robots_need_a_choice(tmp_path):
    robots = {f'/r{k}': Hidden(delay=0.1 * k) for k in (1, 2)}
    bag = record(tmp_path / 'bag', robots['/r1'], others={'/r2': robots['/r2']})
    with pytest.raises(BagError, match=r'found /r1/odom, /r2/odom, wanted those of one robot'):
        identify([bag])
    found = identify([bag], Sources('/r2/odom'))
    assert found.drives[0].label.endswith('/r2/odom, /r2/cmd_vel')
    assert check(found, robots['/r2']) == []
