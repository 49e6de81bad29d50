"""All compiled code that a run may come to need, made or loaded before it begins."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.formulation.ocp_formulation import Task
from cmpsp_ros.guidance.horizon import remaining, to_nanoseconds
from cmpsp_ros.guidance.law import GuidanceLaw, warm_up
from cmpsp_ros.guidance.mission.goals import line_ahead, place_of, way_along
from cmpsp_ros.guidance.planning.candidate import Candidate
from cmpsp_ros.guidance.planning.homotopy.homotopy_class import signature_of
from cmpsp_ros.guidance.planning.homotopy.path_search import ways_through
from cmpsp_ros.guidance.planning.initial_trajectories import along_road, ways_left
from cmpsp_ros.guidance.planning.planner import Planner
from cmpsp_ros.guidance.planning.ranking import Judge
from cmpsp_ros.guidance.safety.audit import Audit
from cmpsp_ros.guidance.settings import GuidanceSettings
from cmpsp_ros.mpsp.problem import Hessian
from cmpsp_ros.mpsp.qp import CLARABEL
from cmpsp_ros.world.free_space import FreeSpace
from cmpsp_ros.world.obstacles.moving_discs import MovingDiscs
from cmpsp_ros.world.roads.corridor import Corridor
from cmpsp_ros.world.roads.road import Annulus

Array = NDArray[np.float64]

_A_LIMIT = 50.0
_STEPS, _PLANS = 8, 2
_STEPS_ACROSS = 50
_A_ROAD = Corridor(((0.0, 0.0), (1.0, 0.0)), (1.0, 1.0), (1.0, 1.0))
_A_DISC = MovingDiscs(('disc',), np.zeros((1, 5)), 0.0, np.zeros(1, np.int64))


def prepare(settings: GuidanceSettings) -> None:
    """Decide in all the ways that the settings, or live changes of them, may ask for.

    After it neither an emergency nor a parameter that is changed under way makes a control step
    wait for a compiler.

    Raises:
        ValueError: The settings cannot be worked with.
    """
    settings = _made_short(settings)
    run_kernels(settings)
    warm_up(settings)
    _meet_trouble(settings)
    _meet_difficulties(settings)
    circular = _on_annulus(settings)
    _look_for_ways(circular)
    _compare_plans(circular)
    for each in _reachable(settings):
        if each != settings:
            warm_up(each)
            _meet_trouble(each)


def run_kernels(settings: GuidanceSettings) -> None:
    """Run every kernel of robot and road beside those of the planner.

    Each of them is compiled once, for all kinds of road.
    """
    pose, controls, durations = _A_ROAD.middle(), np.zeros((2, 2)), np.ones(1)
    on_road = replace(settings, road=_A_ROAD, goal=(1.0, 0.0), obstacles=())
    on_road.model.roll_out(pose, controls, durations)
    space = FreeSpace.of(_A_ROAD, (), 0.0)
    space.at(pose[None])
    space.along(pose[None], controls[:1], durations)
    _A_DISC.along(pose[None], controls[:1], durations, durations)
    Audit(on_road).check(pose, controls, durations, _A_DISC)
    along_road(on_road, pose, durations)
    ways_left(on_road, pose[None])
    way_along(_A_ROAD, pose, on_road.goal)
    line_ahead(_A_ROAD, pose, 1.0)
    place_of(_A_ROAD, pose, math.nan)


def _made_short(settings: GuidanceSettings) -> GuidanceSettings:
    """Settings whose rehearsal is short: compiled code is the same for any horizon and count."""
    solver = settings.solver
    few = replace(
        solver,
        candidates=min(solver.candidates, _PLANS),
        initial_iterations=min(solver.initial_iterations, solver.iterations_per_step),
    )
    longest = _STEPS * settings.control_period
    return replace(
        settings,
        final_time=min(settings.final_time, longest),
        waypoints=(),
        solver=few,
    )


def _reachable(settings: GuidanceSettings) -> Iterator[GuidanceSettings]:
    """Settings with one thing changed that may be changed live and needs code of its own."""
    for hessian in get_args(Hessian):
        yield replace(settings, solver=replace(settings.solver, hessian=hessian))
    for limit in (_A_LIMIT, math.inf):
        yield replace(settings, robot=replace(settings.robot, max_wheel_speed=limit))
    for delay in (0.0, settings.control_period / 2.0):
        yield replace(settings, command_delay=delay)


def _meet_trouble(settings: GuidanceSettings) -> None:
    """Start well, leave the road, be lost, and be too late: every rung is reached."""
    road, law = settings.road, GuidanceLaw(settings)
    period, final = to_nanoseconds(settings.control_period), to_nanoseconds(settings.final_time)
    on, off = road.middle(), road.beside()
    for step, pose in enumerate((on, on, off, off, on)):
        law.update(step * period, pose)
    law.halt(5 * period, 'A rehearsal.')
    law.update(final - period // 2, on)
    law.update(final, on)


def _meet_difficulties(settings: GuidanceSettings) -> None:
    """Run what is seldom needed: Clarabel, which is imported when it is first asked."""
    road = settings.road
    planner = Planner(replace(settings, solver=replace(settings.solver, qp=CLARABEL)))
    period, final = to_nanoseconds(settings.control_period), to_nanoseconds(settings.final_time)
    horizon, pose = remaining(0, period, final), road.middle()
    guess = along_road(settings, pose, horizon.durations)
    planner.improve(pose, np.zeros(2), guess, horizon, iterations=1)


def _on_annulus(settings: GuidanceSettings) -> GuidanceSettings:
    """Settings with a road where plans are compared, which a live change may bring."""
    if isinstance(settings.road, Annulus):
        return settings
    return replace(settings, road=Annulus(), goal=(10.0, 0.0))


def _look_for_ways(settings: GuidanceSettings) -> None:
    """Search as far as from one side of a road to the other, wherever the goal is at present."""
    road = settings.annulus
    pose, durations = road.middle(), np.full(_STEPS_ACROSS, settings.control_period)
    opposite = replace(settings, goal=(2.0 * road.center[0] - float(pose[0]), road.center[1]))
    space = Task(opposite).space(along_road(opposite, pose, durations), durations)
    ways_through(opposite, space, pose, durations)


def _compare_plans(settings: GuidanceSettings) -> None:
    """Tell a plan's way and its merit, which is done where there are several."""
    road = settings.annulus
    period, final = to_nanoseconds(settings.control_period), to_nanoseconds(settings.final_time)
    horizon, pose, held = remaining(0, period, final), road.middle(), np.zeros(2)
    guess = along_road(settings, pose, horizon.durations)
    improvement = Planner(settings).improve(pose, held, guess, horizon, iterations=1)
    plan = improvement.plan
    verdict = Audit(settings).check(pose, plan.controls, horizon.durations)
    Judge(settings).merit(Candidate(improvement, verdict), held)
    signature_of(road, pose[None, :2].copy(), plan.poses, settings.goal)
