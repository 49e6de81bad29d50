"""A demo's parameters, checked before anything starts."""

import pytest

from cmpsp_ros.demo import load_scenario
from cmpsp_ros.parameters import ParameterError
from cmpsp_ros.parameters.files import preset_names


def test_lockstep_brings_the_clock_with_it_and_nodes_wait_to_be_activated():
    plain = load_scenario('case3', [], lockstep=False)
    assert (plain.name, plain.lockstep, plain.duration) == ('case3', False, 10.0)
    assert not plain.values['publish_clock']
    assert not plain.values['autostart']
    for assignments, lockstep in (([], True), (['lockstep=true'], False)):
        scenario = load_scenario('case3', assignments, lockstep=lockstep)
        assert scenario.lockstep
        assert scenario.values['publish_clock']
    assert load_scenario('case3', ['real_time_factor=0.5'], lockstep=False).values['publish_clock']


def test_assignments_change_the_preset_and_later_ones_count():
    scenario = load_scenario(
        'case3',
        ['final_time=11.0', 'final_time=12', 'real_time_factor=4.0', 'goal.position=[9.5, 1]'],
        lockstep=False,
    )
    assert scenario.settings.final_time == 12.0
    assert scenario.settings.goal == (9.5, 1.0)
    assert scenario.duration == 3.0


def test_a_file_is_named_by_its_stem(tmp_path):
    file = tmp_path / 'mine.yaml'
    file.write_text('/**:\n  ros__parameters:\n    final_time: 11.0\n')
    scenario = load_scenario(str(file), [], lockstep=False)
    assert (scenario.name, scenario.settings.final_time) == ('mine', 11.0)


@pytest.mark.parametrize(
    ('preset', 'assignments', 'said'),
    [
        ('case4', [], "'case4': found no such preset"),
        ('./none.yaml', [], 'none.yaml: found'),
        ('case3', ['final_time'], 'found no key=value'),
        ('case3', ['final_time=soon'], "final_time: found 'soon'"),
        ('case3', ['initial_pose=[8.0,-6.0,0.0]'], 'initial_pose: found 0.7 m'),
        ('case3', ['goal.position=[5.0,0.0]'], 'goal.position: found 4 m'),
        ('case3', ['odom_rate=7.0'], 'odom_rate'),
    ],
)
def test_what_a_node_would_refuse_is_refused_before_anything_starts(preset, assignments, said):
    with pytest.raises(ParameterError, match=said):
        load_scenario(preset, assignments, lockstep=True)


def test_all_that_is_wrong_is_told_at_once():
    with pytest.raises(ParameterError) as caught:
        load_scenario('case3', ['final_tim=1.0', 'control_period=-1.0'], lockstep=False)
    assert {problem.where for problem in caught.value.problems} == {'final_tim', 'control_period'}


def test_a_robot_is_laid_over_the_preset_and_given_the_time_it_needs():
    scenario = load_scenario('case3', [], lockstep=False, robot='turtlebot3_burger')
    assert scenario.name == 'case3 with turtlebot3_burger'
    assert scenario.settings.robot.max_speed == pytest.approx(0.22, abs=1e-4)
    assert scenario.settings.initial_guess.type == 'road'
    needed = 14.6 / 0.22 / 0.8
    assert needed < scenario.settings.final_time < needed + 2.0
    (said,) = scenario.remarks
    assert said.endswith('s instead of 10 s: this robot drives at most 0.22 m/s.')


def test_a_robot_that_is_fast_enough_is_given_no_more_time():
    scenario = load_scenario('case3_wide', [], lockstep=False, robot='jackal')
    assert scenario.settings.final_time == 10.0
    assert scenario.remarks == ()


def test_a_final_time_that_was_asked_for_stays_and_is_said_to_be_too_short():
    assignments = ['final_time=10.0', 'robot.radius=0.2']
    scenario = load_scenario('case3', assignments, lockstep=False, robot='turtlebot3_burger')
    assert scenario.settings.final_time == 10.0
    assert scenario.settings.robot_radius == 0.2
    far, narrow = scenario.remarks
    assert far.startswith('The goal is out of reach by 12.')
    assert narrow.startswith('There is no way past obstacle a: ')


def test_the_presets_raise_no_warnings():
    for preset in preset_names():
        assert load_scenario(preset, [], lockstep=False, namespace='/r1').remarks == ()


def test_a_robot_too_large_for_its_course_is_refused():
    with pytest.raises(ParameterError, match=r'initial_pose: found 0\.083 m inside'):
        load_scenario('case3', [], lockstep=False, robot='jackal')
