"""A demo's parameters, checked before anything starts."""

from __future__ import annotations

import pytest

from cmpsp_ros.demo.scenario import load_scenario
from cmpsp_ros.parameters.errors import ParameterError


def test_lockstep_brings_the_clock_with_it_and_nodes_wait_to_be_activated():
    plain = load_scenario('case3', [], lockstep=False)
    assert (plain.name, plain.lockstep, plain.duration) == ('case3', False, 10.0)
    assert not plain.values['publish_clock']
    assert not plain.values['autostart']
    for assignments, lockstep in (([], True), (['lockstep=true'], False)):
        scenario = load_scenario('case3', assignments, lockstep=lockstep)
        assert scenario.lockstep
        assert scenario.values['publish_clock']


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
        ('case4', [], "'case4': found no such preset, wanted a preset"),
        ('./none.yaml', [], 'none.yaml: found No such file or directory'),
        ('case3', ['weights.road_centre=1.0'], r'found an unknown .*mean weights.road_center\?'),
        ('case3', ['final_time'], 'found no key=value'),
        ('case3', ['final_time=soon'], "final_time: found 'soon', wanted a number > 0"),
        ('case3', ['initial_pose=[8.0,-6.0,0.0]'], 'initial_pose: found 0 m from .* obstacle a'),
        ('case3', ['initial_pose=[0.0,0.0,0.0]'], 'initial_pose: found 0 m from road.center'),
        ('case3', ['goal.position=[5.0,0.0]'], 'goal.position: found 5 m from road.center'),
        ('case3', ['road.inner_radius=11.0'], 'road.inner_radius: found 11.0 m, wanted less'),
        ('case1', ['obstacles.names=[rock]'], 'obstacles.rock.center: found nothing, wanted'),
    ],
)
def test_what_is_wrong_is_told_by_key_found_and_wanted(preset, assignments, said):
    with pytest.raises(ParameterError, match=said):
        load_scenario(preset, assignments, lockstep=True)


def test_all_that_is_wrong_is_told_at_once():
    with pytest.raises(ParameterError) as caught:
        load_scenario('case3', ['final_tim=1.0', 'control_period=-1.0'], lockstep=False)
    assert {problem.where for problem in caught.value.problems} == {'final_tim', 'control_period'}


def test_what_the_simulator_would_refuse_is_refused_before_anything_starts():
    for change in ('odom_rate=30.0', 'odom_rate=0.0001', 'real_time_factor=1e9'):
        with pytest.raises(ParameterError, match=change.split('=')[0]):
            load_scenario('case3', [change], lockstep=True)
