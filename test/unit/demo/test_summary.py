"""Figures of runs whose figures are known, from bags of runs that never happened."""

import json
import math
from dataclasses import replace

import bag_messages
import numpy as np
import pytest
from bag_messages import PLAIN_DECISION, joints, odometry, status

from cmpsp_ros.bags import BagError
from cmpsp_ros.bags.runs import read_run
from cmpsp_ros.demo import Summary
from cmpsp_ros.demo.results import draw_controls, draw_trajectory
from cmpsp_ros.demo.summary import summarise, window
from cmpsp_ros.parameters import TABLE, guidance_settings


def decision(stamp, level='nominal', finished=False, step_ms=None, **more):
    told = {'stamp': stamp, 'fallback_level': level, 'finished': str(finished).lower()}
    timed = {} if step_ms is None else {'step_ms': repr(step_ms)}
    return status(f'It is {level}.', **PLAIN_DECISION | told | more | timed)


@pytest.fixture
def write_bag(tmp_path):
    """Write a bag of `truth` (stamp, pose, twist), `wheels` (stamp, speeds) and `decisions`."""

    def write(truth, wheels=((0, (0.0, 0.0)),), decisions=({'stamp': 0},), name='bag'):
        records = [('/sim/truth', stamp, odometry(stamp, *rest)) for stamp, *rest in truth]
        records += [('/sim/wheel_speeds', stamp, joints(stamp, each)) for stamp, each in wheels]
        records += [('/guidance/decision', each['stamp'], decision(**each)) for each in decisions]
        return bag_messages.write_bag(tmp_path / name, records)

    return write


SECOND = 1_000_000_000
RADIUS, SPEED = 10.0, 1.0


def on_circle(seconds):
    """Pose on the centre line of the road after so long at 1 m/s, from (0, -10)."""
    angle = SPEED * seconds / RADIUS
    return RADIUS * math.sin(angle), -RADIUS * math.cos(angle), angle


def settings(obstacles=(), final_time=4.0, goal=None, **changes):
    values = {'final_time': final_time, 'goal.position': list(goal or on_circle(final_time)[:2])}
    values['obstacles.names'] = [f'o{k}' for k in range(len(obstacles))]
    for k, (center, radius) in enumerate(obstacles):
        values[f'obstacles.o{k}.center'] = list(center)
        values[f'obstacles.o{k}.radius'] = radius
    return guidance_settings(TABLE.resolve({**values, **changes}))


def driven(*seconds):
    twist = (SPEED, SPEED / RADIUS)
    return [(round(each * SECOND), on_circle(each), twist) for each in seconds]


@pytest.fixture
def summary_of(write_bag):
    """Figures of a bag: `summary_of(settings, truth, wheels=..., decisions=...)`."""

    def read(chosen, truth, **rest):
        return summarise(read_run(write_bag(truth, **rest)), chosen, 'known')

    return read


def test_an_obstacle_on_the_arc_between_two_samples_is_seen(summary_of):
    x, y, _ = on_circle(1.5)
    summary = summary_of(settings([((x, y), 0.3)]), driven(0, 1, 2, 3, 4))
    assert summary.clearance == pytest.approx(-0.3)
    assert 'cut road edge or obstacle by 0.3 m' in summary.failure
    # Beside the chord, but on the arc; one that the samples alone would not show.
    assert min(math.dist((x, y), on_circle(k)[:2]) for k in range(5)) > 0.3 + 0.15


def test_a_failure_is_not_put_down_to_the_wait_for_the_first_plan(summary_of):
    levels = ['stop', 'nominal', 'elastic']
    decisions = [
        {'stamp': k * 200_000_000, 'level': level, 'step_ms': 5.0} for k, level in enumerate(levels)
    ]
    x, y, _ = on_circle(1.5)
    chosen = settings([((x, y), 0.3)])
    summary = summary_of(chosen, driven(0, 1, 2, 3, 4), decisions=decisions)
    assert 'guidance said: It is elastic.' in summary.failure


def test_a_hole_in_the_true_path_is_not_judged(summary_of):
    x, y, _ = on_circle(2.0)
    seconds = np.arange(0.0, 4.01, 0.05)
    lacking = driven(*seconds[(seconds < 1.2) | (seconds > 2.8)])
    summary = summary_of(settings([((x, y), 0.3)]), lacking)
    assert not summary.has_failed
    assert summary.clearance == pytest.approx(0.55, abs=0.06)
    assert 'not judged: the path is not recorded from 1.15 to 2.80 s (1.65 s)' in summary.failure


def test_a_contact_beside_a_hole_is_one(summary_of):
    seconds = np.arange(0.0, 4.01, 0.05)
    lacking = driven(*seconds[(seconds < 1.2) | (seconds > 2.8)])
    beside = summary_of(settings([(on_circle(0.9)[:2], 0.1)]), lacking)
    assert beside.has_failed
    assert 'by 0.1 m and not judged' in beside.failure


def test_a_goal_in_a_hole_is_not_judged(summary_of):
    chosen = settings(final_time=2.0, goal=on_circle(9.0)[:2])
    seconds = np.arange(0.0, 4.01, 0.05)
    summary = summary_of(chosen, driven(*seconds[(seconds < 1.2) | (seconds > 2.8)]))
    assert (summary.miss, summary.reached, summary.has_failed) == (None, False, False)
    assert summary.failure.startswith('not judged')


def test_an_arc_that_bulges_over_the_outer_edge_is_seen(summary_of):
    # A chord of the circle of 10.99 m, driven straight, lies inside; with a bend it bulges out.
    truth = [
        (0, (-1.0, -10.9, -0.4), (2.02, 0.4)),
        (SECOND, (1.0, -10.9, 0.4), (0.0, 0.0)),
        (4 * SECOND, (1.0, -10.9, 0.4), (0.0, 0.0)),
    ]
    summary = summary_of(settings(goal=(1.0, -10.9)), truth)
    assert summary.clearance < -0.05
    assert summary.reached


def test_the_miss_is_that_at_the_final_time_between_two_samples(summary_of):
    chosen = settings(final_time=2.5, goal=on_circle(2.5)[:2])
    summary = summary_of(chosen, driven(0, 1, 2, 3))
    assert summary.miss < 1e-12
    assert summary.reached
    assert summary.failure == ''
    beside = settings(final_time=2.5, goal=on_circle(2.6)[:2])
    summary = summary_of(beside, driven(0, 1, 2, 3), name='other')
    assert summary.miss == pytest.approx(2.0 * RADIUS * math.sin(0.1 / RADIUS / 2.0))
    assert not summary.reached
    assert 'missed by 0.1 m' in summary.failure


def test_what_happens_before_the_first_decision_and_after_the_final_time_does_not_count(summary_of):
    x, y, _ = on_circle(0.5)
    far = on_circle(9.5)[:2]
    wheels = [(0, (99.0, 0.0)), (SECOND, (1.0, -7.5)), (5 * SECOND, (3.0, 2.0))]
    wheels += [(7 * SECOND, (99.0, 99.0))]
    decisions = [{'stamp': SECOND // 2, 'level': 'stop', 'halted': 'true'}]
    decisions += [{'stamp': (1 + k) * SECOND, 'step_ms': 1.0 + k} for k in range(4)]
    decisions += [{'stamp': 5 * SECOND, 'level': 'stop', 'finished': True, 'step_ms': 900.0}]
    summary = summary_of(
        settings([((x, y), 0.2), (far, 0.2)], goal=on_circle(5.0)[:2]),
        driven(*range(11)),
        wheels=wheels,
        decisions=decisions,
    )
    assert summary.miss < 1e-12
    assert summary.clearance > 0.0
    assert summary.max_wheel_speed == 7.5
    assert summary.control_steps == 4
    assert summary.levels == {'nominal': 4, 'elastic': 0, 'previous_plan': 0, 'stop': 0}
    assert summary.step_times == {'p50': 2.5, 'p99': pytest.approx(3.97), 'max': 4.0}


def test_levels_and_deadlines_are_counted(summary_of):
    levels = ['nominal', 'elastic', 'elastic', 'previous_plan', 'stop']
    times = [10.0, 200.0, 200.1, None, 300.0]
    decisions = [
        {'stamp': k * 200_000_000, 'level': level, 'step_ms': ms}
        for k, (level, ms) in enumerate(zip(levels, times, strict=True))
    ]
    summary = summary_of(settings(), driven(0, 1, 2, 3, 4), decisions=decisions)
    assert summary.levels == {'nominal': 1, 'elastic': 2, 'previous_plan': 1, 'stop': 1}
    assert summary.deadline_misses == 2
    assert summary.control_steps == 5


def test_a_command_that_was_sent_late_or_not_at_all_is_a_missed_deadline(summary_of):
    told = [{'odometry_to_command_ms': ms} for ms in ('210.0', '259.0', '261.0')]
    told += [{'odometry_to_command_ms': '70.0', 'late': '0.25'}]
    decisions = [{'stamp': k * 200_000_000, 'step_ms': 5.0, **one} for k, one in enumerate(told)]
    for delay, missed in ((0.0, 4), (0.06, 2)):
        chosen, name = settings(command_delay=delay), f'delay_{delay}'
        summary = summary_of(chosen, driven(0, 1, 2, 3, 4), decisions=decisions, name=name)
        assert summary.deadline_misses == missed


def test_the_robot_s_own_radius_is_taken_off(summary_of):
    summary = summary_of(settings(**{'robot.radius': 0.25}), driven(0, 1, 2, 3, 4))
    assert summary.clearance == pytest.approx(0.75)


@pytest.mark.parametrize('seconds', [(0, 1, 2, 3), (0, 1, 2, 3.9), (0.5, 2, 5)])
def test_a_recording_that_does_not_cover_the_run_is_refused(write_bag, seconds):
    run = read_run(write_bag(driven(*seconds)))
    with pytest.raises(
        BagError, match=r'path driven is recorded from .* wanted 0 to 4000000000 ns'
    ):
        window(run, settings())


def test_a_summary_has_every_figure_by_name_and_unit():
    numbers = {'p50': 0.1 + 0.2, 'p99': 1e-300, 'max': 1.0 / 3.0}
    summary = Summary('x', True, 5e-324, -0.0, 51.0, numbers, 0, {'nominal': 1}, 1)
    assert summary.values() == {
        'preset': 'x',
        'reached': True,
        'miss_m': 5e-324,
        'clearance_m': -0.0,
        'max_wheel_speed_rad_s': 51.0,
        'step_ms': numbers,
        'deadline_misses': 0,
        'levels': {'nominal': 1},
        'control_steps': 1,
    }


def test_a_summary_without_measured_times_is_still_json(summary_of):
    summary = summary_of(settings(), driven(0, 1, 2, 3, 4))
    assert json.loads(json.dumps(summary.values(), allow_nan=False))['control_steps'] == 1


def test_the_two_failures_are_both_told():
    summary = Summary('x', False, 0.5, -0.1, 1.0, {}, 0, {}, 1)
    assert summary.failure == (
        'the goal was missed by 0.5 m and the path cut road edge or obstacle by 0.1 m'
    )
    said = replace(summary, clearance=0.1, reason='The robot waits.').failure
    assert said == 'the goal was missed by 0.5 m; guidance said: The robot waits.'
    assert replace(summary, clearance=0.1, reached=True, reason='The robot waits.').failure == ''


def test_pictures_are_drawn_without_plans_obstacles_or_limit(write_bag, tmp_path):
    run = read_run(
        write_bag(driven(0, 1, 2, 3, 4), wheels=[(k * SECOND, (k, -k * 1.5)) for k in range(4)])
    )
    chosen = settings(**{'robot.max_wheel_speed': 0.0})
    assert math.isinf(chosen.robot.max_wheel_speed)
    for draw, name in ((draw_trajectory, 'path.png'), (draw_controls, 'wheels.png')):
        draw(run, chosen, tmp_path / name)
        assert (tmp_path / name).read_bytes()[:4] == b'\x89PNG'
    assert np.isfinite(run.driven.poses).all()
