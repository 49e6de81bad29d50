"""What plans are compared by."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scenarios import (
    FIRST,
    PERIOD,
    ROAD,
    SECOND,
    START,
    settings,
)

from cmpsp_ros.guidance.horizon import remaining
from cmpsp_ros.guidance.planning.candidate import Candidate
from cmpsp_ros.guidance.planning.initial_trajectories import along_road
from cmpsp_ros.guidance.planning.planner import Planner
from cmpsp_ros.guidance.planning.ranking import Judge, Merit
from cmpsp_ros.guidance.safety.audit import Audit
from cmpsp_ros.guidance.settings import Safety

BOTH = (FIRST, SECOND)


def test_change_over_needs_a_clear_advantage():
    plain = Merit(True, 0.0, 0.0, 0.0, False, 0, 0.1, 10.0)
    assert not plain.beats(plain)
    assert not plain._replace(cost=8.5).beats(plain)
    assert plain._replace(cost=7.0).beats(plain)
    touching = plain._replace(obstacle=0.1, cost=1.0)
    assert plain.beats(touching)
    assert not touching.beats(plain)
    assert not touching._replace(obstacle=0.09).beats(touching._replace(edge=0.0))
    assert touching._replace(obstacle=0.04, miss=3.0).beats(touching)


def test_the_order_of_merit():
    """Obstacle, edge, goal, slack, turns, reserve, cost: none outweighs what comes before it."""
    best = Merit(True, 0.0, 0.0, 0.0, False, 0, 0.1, 1.0)
    worse = [
        best._replace(cost=100.0),
        best._replace(reserve=0.05),
        best._replace(turns=1),
        best._replace(elastic=True),
        best._replace(miss=0.1),
        best._replace(edge=0.1),
        best._replace(obstacle=0.1),
        best._replace(usable=False),
    ]
    for better, other in zip([best, *worse], worse, strict=False):
        assert better._replace(cost=100.0 * better.cost).beats(other._replace(cost=1e6))
        assert not other.beats(better)
    assert not best.flawed
    assert not any(each.flawed for each in worse[:2])
    assert all(each.flawed for each in worse[2:])


def test_a_little_more_to_spare_is_no_reason_to_change_over():
    plain = Merit(True, 0.0, 0.0, 0.0, False, 0, 0.05, 10.0)
    assert not plain._replace(reserve=0.06).beats(plain)
    assert plain._replace(reserve=0.07).beats(plain)
    assert plain._replace(reserve=0.045, cost=5.0).beats(plain)
    assert not plain._replace(reserve=0.035, cost=5.0).beats(plain)


@pytest.mark.parametrize(('limit', 'wanting'), [(51.0, False), (45.0, True)])
def test_a_plan_that_needs_nearly_all_of_the_wheels_is_wanting(limit, wanting):
    given, pose = settings(BOTH, limit, ROAD), np.array(START)
    horizon, judge = remaining(0, PERIOD, 50 * PERIOD), Judge(given)
    guess = along_road(given, pose, horizon.durations)
    improvement = Planner(given).improve(pose, np.zeros(2), guess, horizon, iterations=6)
    verdict = Audit(given).check(pose, improvement.plan.controls, horizon.durations)
    candidate = Candidate(improvement, verdict)
    merit, speeds = judge.merit(candidate, np.zeros(2)), improvement.plan.controls[:-1]
    spared = 1.0 - np.abs(speeds).max(axis=1).mean() / limit
    assert merit.reserve == pytest.approx(min(spared, 0.1))
    assert not merit.flawed
    assert judge.is_wanting(candidate) == wanting


def test_what_is_in_a_margin_is_a_flaw_before_it_touches_anything():
    given, pose = settings(BOTH, 51.0, ROAD), np.array(START)
    horizon = remaining(0, PERIOD, 50 * PERIOD)
    guess = along_road(given, pose, horizon.durations)
    improvement = Planner(given).improve(pose, np.zeros(2), guess, horizon, iterations=6)
    verdict = Audit(given).check(pose, improvement.plan.controls, horizon.durations)
    assert verdict.nearest.startswith('obstacle')
    for over, depth in ((-0.01, 0.0), (0.02, 0.02)):
        margin = verdict.worst_margin + over
        judge = Judge(replace(given, safety=Safety(margin=margin)))
        merit = judge.merit(Candidate(improvement, verdict), np.zeros(2))
        assert merit.obstacle == pytest.approx(depth, abs=1e-9)
        assert merit.flawed == (depth > 0.0)


def test_a_plan_beside_that_has_no_prospect_is_let_go():
    best = Merit(True, 0.0, 0.0, 0.0, False, 0, 0.1, 1.0)
    assert best.outclasses(best._replace(cost=2.5))
    assert best.outclasses(best._replace(miss=0.1, cost=0.1))
    assert not best.outclasses(best._replace(cost=1.9))
    assert not best._replace(miss=0.1).outclasses(best._replace(miss=1.0))


def test_a_path_that_winds_around_itself_is_wanting():
    given, pose = settings((), 51.0, ROAD), np.array(START)
    horizon, judge = remaining(0, PERIOD, 50 * PERIOD), Judge(given)
    straight = along_road(given, pose, horizon.durations)
    improvement = Planner(given).improve(pose, np.zeros(2), straight, horizon, iterations=6)
    verdict = Audit(given).check(pose, improvement.plan.controls, horizon.durations)
    wound = improvement.plan.poses.copy()
    wound[20:, 2] -= 2.0 * math.pi
    twice = improvement._replace(plan=improvement.plan._replace(poses=wound))
    plain, turned = Candidate(improvement, verdict), Candidate(twice, verdict)
    assert not judge.is_wanting(plain)
    assert judge.is_wanting(turned)
    assert judge.merit(turned, np.zeros(2)).turns == 1
    assert judge.merit(plain, np.zeros(2)).beats(judge.merit(turned, np.zeros(2)))
