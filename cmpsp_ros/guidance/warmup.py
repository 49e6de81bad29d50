"""All compiled code that a run may come to need, made or loaded before it begins."""

import math
from collections.abc import Iterator
from dataclasses import replace
from importlib.util import find_spec
from typing import get_args

import numpy as np

from cmpsp_ros.guidance.formulation.ocp_formulation import OcpFormulation
from cmpsp_ros.guidance.horizon import remaining
from cmpsp_ros.guidance.law import GuidanceLaw
from cmpsp_ros.guidance.planning.homotopy.gaps import fill_blocked
from cmpsp_ros.guidance.planning.homotopy.path_search import searched_line
from cmpsp_ros.guidance.planning.homotopy.road_frame import frame_along
from cmpsp_ros.guidance.planning.initial_trajectories import along_road
from cmpsp_ros.guidance.planning.manoeuvre_search import ManoeuvreSearch, may_need_manoeuvres
from cmpsp_ros.guidance.planning.planner import Planner
from cmpsp_ros.guidance.planning.planning_context import PlanningContext
from cmpsp_ros.guidance.planning.retreat import spread
from cmpsp_ros.guidance.prediction.estimator import Observation, PlanStart
from cmpsp_ros.guidance.prediction.obstacle_tracker import StandingPeople
from cmpsp_ros.guidance.prediction.pending_commands import PendingCommands
from cmpsp_ros.guidance.prediction.response_estimate import ResponseEstimate
from cmpsp_ros.guidance.safety.validation import Validator
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.times import NANOSECONDS, to_nanoseconds
from cmpsp_ros.guidance.world import MAP, GuidanceSettings, World
from cmpsp_ros.mpsp import Hessian
from cmpsp_ros.mpsp.qp import CLARABEL
from cmpsp_ros.robots import TwistLimits
from cmpsp_ros.robots.motion import with_lag
from cmpsp_ros.sensing import Sight, Sighting, Surroundings, Track
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.grids import NO_FIELD, GridObstacle, OccupancyGrid
from cmpsp_ros.world.obstacles import Capsule, MovingDiscs
from cmpsp_ros.world.roads import Annulus, find_near, kinds, lookahead_point, remaining_arc_length

_A_LIMIT = 50.0
_STEPS, _PLANS = 8, 2
_POST = 0.1
_OFF = 1e-11
# Corridors have the same code, and need scipy, which takes a third of a second to import.
_A_ROAD = Annulus()
_A_GRID = OccupancyGrid((50.0, 50.0, 0.0), 0.1, np.eye(8, dtype=np.uint8))
_A_PERSON = Track(Track.SEEN, 0, _POST, *_A_GRID.origin[:2], 0.0, 0.0)
_A_DISC = MovingDiscs(('disc',), np.zeros((1, 7)), np.zeros(1, np.int64))


def prepare(settings: GuidanceSettings) -> None:
    """Decide in all the ways that settings or live changes may ask for, so that all is compiled."""
    if settings.sight.sensors:
        run_sensing(settings)
    settings = _made_short(settings)
    run_kernels(settings)
    warm_up(settings)
    # The same code, without searches for an earlier arrival, which take seconds.
    settings = replace(settings, when='fixed')
    _meet_trouble(settings)
    _meet_difficulties(settings)
    _compare_plans(settings)
    for each in _reachable(settings):
        if each != settings:
            warm_up(each)
            _meet_trouble(each)


def run_sensing(settings: GuidanceSettings) -> None:
    """Run the kernels of sensing: a person stands before a wall, and then is gone."""
    sensor, nowhere = settings.sight.sensors[0], np.zeros(3)
    surroundings = Surroundings(settings.sight, settings.robot_radius, settings.footprint)
    angles = np.linspace(-0.6, 0.6, 32)
    beams, starts = np.column_stack([np.cos(angles), np.sin(angles)]), np.zeros((32, 2))
    wall, is_hit = np.full(32, 2.0), np.ones(32, dtype=bool)
    person = np.where(abs(angles) < 0.15, 1.0, wall)
    stamp = 0
    for ranges in (person, person, wall):
        stamp += NANOSECONDS // 10
        stamps, ends = np.full(32, stamp), ranges[:, None] * beams
        sight = Sight(sensor, stamp, stamps, starts, ends, is_hit, is_sweep=True)
        surroundings.add(sight)
        surroundings.update(stamp, nowhere)
    if (sighting := surroundings.at(stamp, nowhere)) is not None:
        law = GuidanceLaw(settings, settings.world)
        law.step(Observation(0, settings.road.middle(), (), sighting))
        law.after_step()


def warm_up(settings: GuidanceSettings) -> None:
    """Decide once, outside any run, to load all compiled code; ValueError for invalid settings."""
    GuidanceLaw(settings, settings.world).step(Observation(0, settings.road.middle()))


def run_kernels(settings: LawSettings) -> None:
    """Run every kernel of robot and road except those of the planner."""
    for kind in kinds():
        kind.load()
    pose, durations = _A_ROAD.middle(), np.ones(1)
    controls = np.zeros((2, settings.robot.n_controls))
    on_road = replace(settings, goal=(0.0, 10.0))
    on_road.robot.roll_out(pose, controls, durations)
    with_lag(controls[0].copy(), controls, np.ones(2), 1.0, 1)
    commands, response = PendingCommands(len(controls[0])), ResponseEstimate(on_road)
    for stamp in (0, NANOSECONDS):
        # Off by a motion that the wheels can make.
        response.update(stamp, pose + stamp * _OFF, commands, on_road.robot, 0.0)
    response.response(0, commands, 0.0, 1.0)
    space = FreeSpace.of(_A_ROAD, (), 0.0)
    space.at(pose[None])
    line = searched_line(space, pose[:2], np.array(on_road.goal))
    blocked = np.zeros((len(line), 1), dtype=bool)
    fill_blocked(blocked, NO_FIELD, 0.0, frame_along(line), np.zeros(1))
    twists = on_road.robot.twist(controls[:1])
    space.along(pose[None], twists, durations)
    _A_DISC.along(pose[None], twists, durations, durations)
    place = np.zeros((1, 1, 2))
    spread(np.zeros((2, 1, 1), dtype=bool), blocked[:1], place, place, np.zeros((1, 1)))
    _A_DISC.tightened(np.arange(2.0), TwistLimits(1.0, 1.0), 1.0, pose)
    start = PlanStart(pose, on_road.robot, World(_A_ROAD), _A_DISC, previous_control=controls[0])
    start = start._replace(reachable=_A_DISC, touchable=_A_DISC)
    Validator(on_road).check(start, controls, durations)
    people, sighting = StandingPeople(), Sighting(0, _A_GRID)
    for tracks in ((_A_PERSON,), ()):
        people.update(0, tracks, sighting, settings.tracked)
    along_road(on_road, start, on_road.target, durations)
    if may_need_manoeuvres(on_road):
        ManoeuvreSearch(on_road, start, on_road.target._replace(heading=0.0)).advance()
    remaining_arc_length(_A_ROAD, pose[None], on_road.goal, None)
    lookahead_point(_A_ROAD, pose, 1.0)
    find_near(_A_ROAD.space(0.0), pose[0], pose[1], pose[2], math.nan, 0.0)


def _made_short(settings: GuidanceSettings) -> GuidanceSettings:
    """Settings with a short warm-up: compiled code is the same for any horizon and count."""
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
        # The places of the warm-up may be in its walls, and the code is the same without it.
        obstacles=tuple(each for each in settings.obstacles if each.corners),
    )


def _reachable(settings: GuidanceSettings) -> Iterator[GuidanceSettings]:
    """Settings with one thing changed that may be changed live and needs code of its own."""
    for hessian in get_args(Hessian):
        yield replace(settings, solver=replace(settings.solver, hessian=hessian))
    for limit in (_A_LIMIT, math.inf):
        yield replace(settings, robot=replace(settings.robot, max_wheel_speed=limit))
    for delay in (0.0, settings.control_period / 2.0):
        yield replace(settings, command_delay=delay)
    grid = GridObstacle(MAP, _A_GRID, True)
    yield replace(settings, obstacles=(*settings.obstacles, grid))


def _meet_trouble(settings: GuidanceSettings) -> None:
    """Start well, leave the road, be lost, and be too late: every fallback level is reached."""
    road, law = settings.road, GuidanceLaw(settings, settings.world)
    period, final = to_nanoseconds(settings.control_period), to_nanoseconds(settings.final_time)
    on, off = road.middle(), road.beside()
    for step, pose in enumerate((on, on, off, off, on)):
        law.step(Observation(step * period, pose))
    law.halt(5 * period, 'A rehearsal.')
    law.step(Observation(final - period // 2, on))
    law.step(Observation(final, on))


def _meet_difficulties(settings: GuidanceSettings) -> None:
    """Run the rarely used fallback: Clarabel, which is imported on first use, where it is there."""
    name = CLARABEL if find_spec('clarabel') else 'hildreth'
    by_name = replace(settings, solver=replace(settings.solver, qp=name))
    period, final = to_nanoseconds(settings.control_period), to_nanoseconds(settings.final_time)
    horizon, pose = remaining(0, period, final), settings.road.middle()
    context = PlanningContext.at_pose(by_name, settings.world, pose, horizon)
    planner = Planner(OcpFormulation(by_name, settings.world))
    planner.improve(context, context.center_line_guess, iterations=1)


def _compare_plans(settings: GuidanceSettings) -> None:
    """Decide on a road where plans are compared, which a live change may bring, beside a wall."""
    road, solver = Annulus(), replace(settings.solver, candidates=_PLANS)
    opposite = -road.center_radius, 0.0
    wall = Capsule('wall', opposite, (opposite[0], _POST), _POST)
    warm_up(
        replace(settings, road=road, goal=opposite, follow=None, obstacles=(wall,), solver=solver)
    )
