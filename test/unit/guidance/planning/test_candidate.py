"""Comparison of plans."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scenarios import FIRST, PERIOD, ROAD, SECOND, START, context_of, settings

from cmpsp_ros.guidance import Safety, remaining
from cmpsp_ros.guidance.formulation import OcpFormulation
from cmpsp_ros.guidance.planning import Planner
from cmpsp_ros.guidance.planning.candidate import Candidate, Ranking, Score
from cmpsp_ros.guidance.safety import Validator

BOTH = (FIRST, SECOND)


def improved(given):
    """Control step, plan along the centre line after six iterations, and verdict on it."""
    context = context_of(given, np.array(START), remaining(0, PERIOD, 50 * PERIOD))
    planner = Planner(OcpFormulation(given, given.world))
    result = planner.improve(context, context.center_line_guess, 6)
    durations = context.horizon.durations
    return (context, result, Validator(given).check(context.start, result.plan.controls, durations))


def test_change_over_needs_a_clear_advantage():
    plain = Score(reserve=0.1, cost=10.0)
    assert not plain.beats(plain)
    assert not plain._replace(cost=8.5).beats(plain)
    assert plain._replace(cost=7.0).beats(plain)
    touching = plain._replace(obstacle=0.1, cost=1.0)
    assert plain.beats(touching)
    assert not touching.beats(plain)
    assert not touching._replace(obstacle=0.09).beats(touching._replace(edge=0.0))
    assert touching._replace(obstacle=0.04, terminal_error=3.0).beats(touching)


def test_the_order_of_criteria():
    """Obstacle, edge, goal, slack, turns, reserve, cost: none outweighs what comes before it."""
    best = Score(reserve=0.1, cost=1.0)
    worse = [
        best._replace(cost=100.0),
        best._replace(reserve=0.05),
        best._replace(turns=1),
        best._replace(elastic=True),
        best._replace(terminal_error=0.1),
        best._replace(edge=0.1),
        best._replace(obstacle=0.1),
        best._replace(admissible=False),
    ]
    for better, other in zip([best, *worse], worse, strict=False):
        assert better._replace(cost=100.0 * better.cost).beats(other._replace(cost=1e6))
        assert not other.beats(better)
    assert not best.flawed
    assert not any(each.flawed for each in worse[:2])
    assert all(each.flawed for each in worse[2:])


def test_a_little_more_to_spare_is_no_reason_to_change_over():
    plain = Score(reserve=0.05, cost=10.0)
    assert not plain._replace(reserve=0.06).beats(plain)
    assert plain._replace(reserve=0.07).beats(plain)
    assert plain._replace(reserve=0.045, cost=5.0).beats(plain)
    assert not plain._replace(reserve=0.035, cost=5.0).beats(plain)


@pytest.mark.parametrize(('limit', 'replanned'), [(51.0, False), (45.0, True)])
def test_a_plan_that_needs_nearly_all_of_the_wheels_needs_replanning(limit, replanned):
    given = settings(BOTH, limit, ROAD)
    context, result, verdict = improved(given)
    ranking = Ranking(given, compares=True)
    candidate = Candidate.of(result, verdict, given.target)
    score, speeds = ranking.score(candidate, context.start), result.plan.controls[:-1]
    spared = 1.0 - np.abs(speeds).max(axis=1).mean() / limit
    assert score.reserve == pytest.approx(min(spared, 0.1))
    assert not score.flawed
    assert ranking.needs_replanning(candidate, context.start) == replanned


def test_what_is_in_a_margin_is_a_flaw_before_it_touches_anything():
    given = settings(BOTH, 51.0, ROAD)
    context, result, verdict = improved(given)
    assert verdict.nearest.startswith('obstacle')
    for over, depth in ((-0.01, 0.0), (0.02, 0.02)):
        margin = verdict.worst_margin + over
        ranking = Ranking(replace(given, safety=Safety(margin=margin)), compares=True)
        score = ranking.score(Candidate.of(result, verdict, given.target), context.start)
        assert score.obstacle == pytest.approx(depth, abs=1e-9)
        assert score.flawed == (depth > 0.0)


def test_a_plan_beside_that_has_no_prospect_is_let_go():
    best = Score(reserve=0.1, cost=1.0)
    assert best.outclasses(best._replace(cost=2.5))
    assert best.outclasses(best._replace(terminal_error=0.1, cost=0.1))
    assert not best.outclasses(best._replace(cost=1.9))
    assert not best._replace(terminal_error=0.1).outclasses(best._replace(terminal_error=1.0))


def test_a_path_that_winds_around_itself_is_replanned():
    given = settings((), 51.0, ROAD)
    context, result, verdict = improved(given)
    ranking = Ranking(given, compares=True)
    wound = result.plan.poses.copy()
    wound[20:, 2] -= 2.0 * math.pi
    twice = result._replace(plan=result.plan._replace(poses=wound))
    plain, turned = (Candidate.of(each, verdict, given.target) for each in (result, twice))
    assert not ranking.needs_replanning(plain, context.start)
    assert ranking.needs_replanning(turned, context.start)
    assert ranking.score(turned, context.start).turns == 1
    assert ranking.score(plain, context.start).beats(ranking.score(turned, context.start))
