"""Every check passes a good drive and catches a bad one."""

import numpy as np
import pytest
from drives import AGAIN, LATENCY, SECOND, START, drive_case, failed

from cmpsp_ros.bags.audit import CHECKS, CheckOutcome, Sources, overall
from cmpsp_ros.bags.decision_record import decision_message
from cmpsp_ros.guidance import Goal
from cmpsp_ros.parameters import TABLE, guidance_settings
from cmpsp_ros.robots import placed

PASSED, FAILED, SKIPPED, NOT_JUDGED = CheckOutcome

CENTER = 'obstacles.a.center'


def test_a_good_drive_passes_every_check(drive, outcomes):
    findings = outcomes(drive)
    assert list(findings) == [each.name for each in CHECKS]
    assert {name for name, each in findings.items() if each.outcome is SKIPPED} == {
        'moving',
        'people',
        'others',
        'margin',
        'acceleration',
        'jerk',
        'lateral_acceleration',
        'steering',
        'promise',
        'unseen',
    }
    assert failed(findings) == set()
    assert findings['goal'].worst < 1e-6
    assert findings['goal'].at == pytest.approx(10.0)
    assert findings['wheel_limits'].worst == pytest.approx(51.0)
    assert all(each.sentence.endswith('.') for each in findings.values())


def test_a_good_drive_on_a_road_that_crosses_itself_passes(outcomes):
    findings = outcomes(drive_case('corridor'))
    assert failed(findings) == set()
    assert 'the left road edge' in findings['road'].sentence
    # The loop is a corridor of half-width 0.6 m, and the robot goes round two obstacles.
    assert 0.4 < findings['road'].worst < 0.6
    assert findings['goal'].worst < 1e-6


def test_leaving_a_road_along_a_line_is_caught(outcomes):
    drive = drive_case('corridor')
    for each in drive.odometry:
        if each.stamp > START + 12 * SECOND:
            each.pose = np.add(each.pose, [0.0, -0.9, 0.0])
    findings = outcomes(drive)
    assert {'road', 'jumps'} <= failed(findings)
    # There the road leads westward.
    assert 'the left road edge' in findings['road'].sentence


def test_open_floor_has_no_edges_to_be_checked(outcomes):
    changes = {'road.type': 'none', 'initial_guess.type': 'road'}
    findings = outcomes(drive_case('case3', **changes))
    assert failed(findings) == set()
    assert findings['road'].outcome is SKIPPED
    assert 'road.type is none' in findings['road'].sentence
    assert findings['goal'].worst < 1e-6


def test_leaving_the_road_is_caught(drive, outcomes):
    for each in drive.odometry:
        if 4.0 <= (each.stamp - START) / SECOND < 4.4:
            each.pose = each.pose * [1.15, 1.15, 1.0]
    findings = outcomes(drive)
    assert {'road', 'jumps', 'nominal'} <= failed(findings)
    assert findings['road'].at == pytest.approx(4.2, abs=0.25)
    assert 'outer road edge' in findings['road'].sentence
    assert findings['jumps'].worst > 1.0


def test_an_obstacle_between_two_samples_is_seen(drive, outcomes):
    path = np.array([each.pose for each in drive.odometry])
    middle = (path[50] + path[51])[:2] / 2.0
    drive.parameters['obstacles.a.center'] = middle.tolist()
    drive.parameters['obstacles.a.radius'] = 0.001
    assert np.linalg.norm(path[:, :2] - middle, axis=1).min() > 0.01
    findings = outcomes(drive)
    assert 'obstacles' in failed(findings)
    assert findings['obstacles'].at == pytest.approx(1.0, abs=0.03)


def test_the_robot_s_radius_and_the_margin_count(drive, outcomes):
    drive.parameters['robot.radius'] = 0.05
    drive.parameters['safety.margin'] = 0.01
    findings = outcomes(drive)
    assert findings['obstacles'].worst == pytest.approx(0.0134, abs=1e-3)
    assert failed(findings) == set()
    assert findings['margin'].outcome is PASSED


def test_what_was_driven_is_judged_by_the_corners_of_a_robot(drive, outcomes):
    box = np.array([[0.15, -0.04], [0.15, 0.04], [-0.05, 0.04], [-0.05, -0.04]])
    drive.parameters['robot.footprint'] = str(box.tolist())
    finding = outcomes(drive)['obstacles']
    poses = np.array([each.pose for each in drive.odometry if each.stamp <= START + 10 * SECOND])
    way = np.linspace(0.0, 4.0, 400, endpoint=False)[:, None]
    sides = box[way[:, 0].astype(int)] * (1.0 - way % 1.0)
    sides += box[(way[:, 0].astype(int) + 1) % 4] * (way % 1.0)
    settings = guidance_settings(TABLE.resolve(drive.parameters))
    away = np.inf
    for pose in poses:
        points = placed(sides, pose)
        for each in settings.obstacles:
            away = min(away, np.hypot(*(points - each.center).T).min() - each.radius)
    assert away - 3e-3 < finding.worst <= away + 1e-6
    assert 'radius' not in finding.sentence
    # A disc that covers it reaches further.
    assert away > settings.world.free_space(settings).at(poses)[:, 2:].min() + 1e-3


def test_a_margin_that_is_not_kept_is_caught(drive, outcomes):
    drive.parameters['safety.margin'] = 0.1
    assert failed(outcomes(drive)) == {'margin'}


def test_a_goal_that_is_missed_is_caught(drive, outcomes):
    drive.parameters['goal.position'] = [10.0, 0.1]
    findings = outcomes(drive)
    assert failed(findings) == {'goal'}
    assert findings['goal'].worst == pytest.approx(0.1)


def test_a_goal_that_is_put_off_when_it_is_due_is_judged_at_its_later_time(drive, outcomes):
    drive.parameters['goal.may_be_late'] = True
    place = tuple(drive.parameters['goal.position'])
    for k, each in enumerate(drive.decisions):
        later = each.stamp >= START + 5 * SECOND
        drive.decisions[k] = each._replace(goal=Goal(place, 10.0 if later else 5.0))
    found = outcomes(drive)['goal']
    assert (found.outcome, found.at) == (PASSED, 10.0)
    assert 'of 2 goals' not in found.sentence


def test_a_recording_that_ends_early_says_nothing_about_the_end(drive, outcomes):
    findings = outcomes(drive.until(4.1))
    assert failed(findings) == set()
    assert findings['goal'].outcome is findings['stop_at_end'].outcome is NOT_JUDGED
    assert overall(findings.values()) is NOT_JUDGED
    assert '5.9 s before' in findings['goal'].sentence


def test_nothing_within_reach_is_said_in_words(drive, outcomes):
    here = ('road.type', 'obstacles.names', 'obstacles.a', 'obstacles.b')
    for key in [each for each in drive.parameters if each.startswith(here)]:
        del drive.parameters[key]
    drive.parameters.update({'road.type': 'none', 'obstacles.names': [], 'safety.margin': 0.1})
    findings = outcomes(drive)
    for check in ('commanded', 'margin', 'nominal'):
        assert findings[check].outcome is PASSED
        assert findings[check].worst is None
        assert 'within reach' in findings[check].sentence
    assert findings['obstacles'].outcome is SKIPPED


def test_another_clock_at_the_recorder_s_is_no_old_odometry(drive, outcomes):
    for each in (*drive.odometry, *drive.commands):
        each.received += 1000 * SECOND
    drive.decisions = []
    assert outcomes(drive)['age'].outcome is PASSED


@pytest.mark.parametrize('rate', [0.2, 3.0])
def test_a_recorder_s_clock_that_runs_at_another_rate_makes_no_command_late(drive, outcomes, rate):
    for each in (*drive.odometry, *drive.commands):
        each.received = round(rate * (each.received - START))
    drive.decisions = []
    assert outcomes(drive)['rate'].outcome is PASSED


def test_a_robot_that_is_not_stopped_at_the_end_is_caught(drive, outcomes):
    del drive.commands[-1], drive.decisions[-1]
    while drive.commands[-1].twist[0] == 0.0:
        del drive.commands[-1], drive.decisions[-1]
    findings = outcomes(drive)
    assert 'stop_at_end' in failed(findings)


def test_an_obstacle_that_comes_later_was_not_there_before(drive, outcomes):
    behind = drive.odometry[100].pose[:2].tolist()
    drive.changes = [(START + 5 * SECOND, 'obstacles.a.center', behind)]
    assert failed(outcomes(drive)) == set()


def test_an_obstacle_put_in_the_way_is_there_from_then_on(drive, outcomes):
    ahead = drive.odometry[300].pose[:2].tolist()
    drive.changes = [(START + 1 * SECOND, 'obstacles.a.center', ahead)]
    findings = outcomes(drive)
    assert 'obstacles' in failed(findings)
    assert findings['obstacles'].at == pytest.approx(6.0, abs=0.1)


@pytest.mark.parametrize('changed_back', [False, True])
def test_a_node_started_anew_is_judged_by_its_new_parameters(drive, outcomes, changed_back):
    ahead = drive.odometry[300].pose[:2].tolist()
    drive.restarts = [(START + 1 * SECOND, {**drive.parameters, CENTER: ahead})]
    if changed_back:
        drive.changes = [(START + 2 * SECOND, CENTER, drive.parameters[CENTER])]
    assert ('obstacles' in failed(outcomes(drive))) == (not changed_back)


def test_every_run_is_judged_by_its_own_goal(drive, outcomes):
    other = drive.later(20.0, run=1)
    bad = other.odometry[500 - 1 : 502]
    for each in bad:
        each.pose = np.add(each.pose, [0.05, 0.0, 0.0])
    drive.odometry += other.odometry
    drive.commands += other.commands
    drive.decisions += other.decisions
    findings = outcomes(drive)
    assert findings['goal'].outcome is FAILED
    assert findings['goal'].at == pytest.approx(30.0)
    assert findings['rate'].outcome is PASSED


def begun_again(drive, seconds, later):
    """The drive until a time, and then another run of it."""
    first, other = drive.until(seconds), drive.later(later, run=1)
    first.odometry += other.odometry
    first.commands += other.commands
    first.decisions += other.decisions
    return first


def test_a_run_begun_again_before_its_goal_is_not_judged_by_it(drive, outcomes):
    findings = outcomes(begun_again(drive, 4.0, 5.0))
    assert findings['goal'].outcome is PASSED
    assert findings['goal'].at == pytest.approx(15.0)
    assert 'goals' not in findings['goal'].sentence


def test_a_node_started_anew_may_have_fewer_waypoints(drive, outcomes):
    names = {'waypoints.names': ['w'], 'waypoints.w.time': 9.0}
    place = {'waypoints.w.position': drive.odometry[450].pose[:2].tolist()}
    again = begun_again(drive, 8.0, 8.5)
    again.parameters = {**drive.parameters, **names, **place}
    again.restarts = [(START + round(8.4 * SECOND), drive.parameters)]
    findings = outcomes(again)
    assert findings['goal'].outcome is PASSED
    assert findings['goal'].at == pytest.approx(18.5)


def test_time_that_jumps_back_begins_a_new_leg(drive, outcomes):
    findings = outcomes(drive.again())
    assert failed(findings) - {'rate'} == set()
    assert findings['goal'].outcome is PASSED


@pytest.mark.parametrize('leg', [0, 1])
def test_the_level_is_judged_in_each_part_of_a_recording(drive, outcomes, leg):
    twice, decisions = drive.again(), drive.decisions
    twice.decisions = decisions
    for each in decisions:
        said = decision_message(each._replace(run=1), '/guidance')
        twice.records.append(('/guidance/decision', each.stamp + LATENCY + AGAIN, said))
    for each in twice.odometry[leg * len(drive.odometry) :][200:220]:
        each.pose = each.pose * [1.15, 1.15, 1.0]
    findings = outcomes(twice)
    assert 'nominal' in failed(findings)
    assert findings['nominal'].at == pytest.approx(4.2, abs=0.25)


def test_noise_that_odometry_admits_is_no_jump(drive, outcomes):
    noise = np.random.default_rng(1)
    for each in drive.odometry:
        each.pose = each.pose + noise.normal(0.0, 0.01, 3)
        each.spread = 0.01
    findings = outcomes(drive)
    assert findings['jumps'].outcome is PASSED
    assert findings['obeyed'].outcome is PASSED


def foreign(drive):
    """As a robot of others would be recorded."""
    drive = drive.without_node()
    drive.stamped, drive.odom, drive.cmd_vel = True, 'base/odometry', 'nav/cmd_vel'
    return drive


def test_a_bag_of_another_robot_is_judged_by_what_is_known(drive, outcomes, tmp_path):
    known = tmp_path / 'robot.yaml'
    known.write_text(
        '/**:\n  ros__parameters:\n    control_period: 0.2\n    robot:\n'
        '      wheel_radius: 0.035\n      half_track: 0.055\n      max_wheel_speed: 51.0\n'
    )
    findings = outcomes(foreign(drive), Sources('/base/odometry', '/nav/cmd_vel', known))
    assert failed(findings) == set()
    judged = {name for name, each in findings.items() if each.outcome is PASSED}
    assert judged == {'jumps', 'finite', 'wheel_limits', 'obeyed', 'stop_at_end'}
    assert 'road.center' in findings['road'].sentence
    assert '/guidance/decision' not in findings['road'].sentence


def test_a_bag_of_another_robot_can_be_judged_by_everything(drive, outcomes, tmp_path):
    findings = outcomes(foreign(drive), Sources('/base/odometry', '/nav/cmd_vel', 'case3'))
    assert failed(findings) == set()
    assert findings['goal'].outcome is PASSED
    assert findings['commanded'].outcome is PASSED
    skipped = {name for name, each in findings.items() if each.outcome is SKIPPED}
    of_ours = {'as_decided', 'reasons', 'previous_plan', 'nominal'}
    limits = {'acceleration', 'jerk', 'lateral_acceleration', 'steering'}
    of_none = {'moving', 'people', 'others', 'margin', *limits, 'promise'}
    assert skipped == {*of_none, *of_ours, 'unseen'}


def test_a_drive_backwards_is_followed_too(outcomes):
    drive = drive_case()
    for each in drive.odometry:
        each.pose = np.add(each.pose, [0.0, 0.0, np.pi])
    for each in drive.commands:
        each.twist = each.twist * [-1.0, 1.0]
    drive.decisions = []
    assert failed(outcomes(drive)) == set()
