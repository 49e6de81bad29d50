"""Kernels are compiled once, whatever the road and what is kept from its edges."""

import subprocess
import sys

import numpy as np
import pytest

from cmpsp_ros.guidance import Weights
from cmpsp_ros.guidance.formulation import GuidanceProblem, ocp_functions
from cmpsp_ros.mpsp.qp.riccati import row_type, stage_type
from cmpsp_ros.robots import DifferentialDrive, TwistLimits
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import Obstacle
from cmpsp_ros.world.roads import Annulus, Corridor, OpenFloor

LINE = Corridor(((0.0, -9.0), (9.0, 0.0), (0.0, 9.0)), (1.0, 1.0, 1.0), (1.5, 1.5, 1.5))
OBSTACLES = (Obstacle('a', (8.0, -6.0), 0.7),)
STEPS = 6

# In a process of its own: only there has nothing else been compiled.
PROGRAM = """
import gc
import math
from dataclasses import replace

import numpy as np
from numba.core.dispatcher import Dispatcher

from cmpsp_ros.guidance.planning import along_road
from cmpsp_ros.guidance.prediction import PlanStart
from cmpsp_ros.guidance.safety import Validator
from cmpsp_ros.guidance.warmup import run_kernels
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import MovingDiscs, convex
from cmpsp_ros.world.roads import (
    Annulus,
    Corridor,
    OpenFloor,
    arc_length_to,
    lookahead_point,
    project_on_path,
    remaining_arc_length,
)


def code():
    dispatchers = [each for each in gc.get_objects() if isinstance(each, Dispatcher)]
    ours = [each for each in dispatchers if each.__module__.startswith('cmpsp_ros')]
    return {(each.__module__, each.__name__, str(sig)) for each in ours for sig in each.signatures}


settings = guidance_settings(TABLE.resolve(load_parameter_file('case3')))
run_kernels(settings)
before = code()
assert before
line = Corridor(((0.0, -9.0), (9.0, 0.0), (0.0, 9.0)), (1.0, 1.0, 1.0), (1.5, 1.5, 1.5))
shape = convex('p', [(-4.0, -1.0), (-2.0, -1.0), (-2.0, 0.5)])
discs = MovingDiscs(('m',), np.ones((1, 7)), np.array([2]))
controls, durations, times = np.full((4, 2), 5.0), np.full(3, 0.2), np.arange(3.0)
for road in (Annulus(), line, OpenFloor()):
    for obstacles in ((), (shape,), settings.obstacles):
        given, pose = replace(settings, road=road, obstacles=obstacles), road.middle()
        poses = given.robot.roll_out(pose, controls, durations)
        space = FreeSpace.of(road, obstacles, 0.1)
        space.at(poses, 1.0)
        space.for_samples_of(controls[:3], 0.2).at(poses)
        space.along(poses[:3], controls[:3], durations)
        discs.along(poses[:3], controls[:3], durations, times)
        start = PlanStart(pose, given.robot, given.world)
        Validator(given).check(start, controls, durations)
        beside = PlanStart(pose, given.robot, given.world, discs, 1.0)
        Validator(given).check(beside, controls, durations)
        along_road(given, start, given.target, durations)
        remaining_arc_length(road, poses, given.goal, None)
        arc_length_to(road, pose, given.goal, 0.5)
        lookahead_point(road, pose, 1.0)
        project_on_path(road, pose, 0.0)
print(*sorted(code() - before), sep='\\n')
"""


def test_the_preparation_meets_all_kernels_of_any_road():
    done = subprocess.run(
        [sys.executable, '-c', PROGRAM], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == []


def spaces(road):
    """All forms that a space takes on its way to a plan."""
    whole, twists = FreeSpace.of(road, OBSTACLES, 0.1), np.full((STEPS, 2), 0.5)
    samples, own = (
        whole.tightened(TwistLimits(1.8, 30.0, 0.055), 0.2),
        whole.for_samples_of(twists, 0.2),
    )
    some = samples.with_some(np.arange(STEPS + 1) % 2 == 0, own)
    discs = np.ones((STEPS + 1, 2, 2)), np.full((STEPS + 1, 2), 0.3)
    return whole, samples, own, some, some.with_points(*discs)


def problem(space, outputs=2):
    return GuidanceProblem(
        DifferentialDrive(max_wheel_speed=51.0),
        space,
        Weights(15.0, 2.0, 0.3),
        np.array([0.3, -8.8, 0.1]),
        np.array([9.0, 0.0]),
        np.full(STEPS, 0.2),
        heading=0.7,
        outputs=outputs,
    )


@pytest.mark.parametrize('outputs', [1, 2, 3])
def test_one_compilation_serves_every_road(outputs):
    kernels = (ocp_functions.predict, ocp_functions.evaluate, ocp_functions.linearise)
    U, counts = np.full((STEPS + 1, 2), 45.0), []
    for road in (Annulus(), LINE, OpenFloor()):
        for space in spaces(road):
            posed = problem(space, outputs)
            X = posed.predict(U)
            posed.evaluate(X, U)
            posed.linearise(X, U)
            counts.append([len(kernel.signatures) for kernel in kernels])
    assert counts == counts[:1] * len(counts)


def test_derivatives_are_written_where_they_belong_in_arrays_that_are_too_long():
    """With two more states than the pose, and room for more stages than there are."""
    posed = problem(FreeSpace.of(Annulus(), OBSTACLES, 0.1), outputs=3)
    U = np.random.default_rng(0).normal(45.0, 1.0, (STEPS + 4, 2))
    X, g, errors = np.full((STEPS + 4, 5), 7.0), np.full((STEPS + 4, 3), 7.0), np.empty(3)
    stages, row = np.zeros(STEPS + 4, stage_type(5, 2)), row_type(5, 2)
    path, terminal = np.zeros((STEPS + 4, 3), row), np.zeros(3, row)
    ocp_functions.predict(posed.data, U, X)
    cost = ocp_functions.evaluate(posed.data, X, U, errors, g)
    ocp_functions.linearise(posed.data, X, U, stages, path, terminal)
    assert (X[:, 3:] == 7.0).all()
    assert (X[STEPS + 1 :] == 7.0).all()
    assert (g[STEPS + 1 :] == 7.0).all()
    for records in (stages, path):
        assert not any(records[STEPS + 1 :].tobytes())
    U, X = U[: STEPS + 1], X[: STEPS + 1, :3]
    evaluation, lin = posed.evaluate(X, U), posed.linearise(X, U)
    assert cost == evaluation.cost
    pairs = {
        'A': stages['A'][:STEPS, :3, :3],
        'B': stages['B'][:STEPS, :3],
        'L_X': stages['L_X'][: STEPS + 1, :3],
        'L_U': stages['L_U'][: STEPS + 1],
        'L_XX': stages['L_XX'][: STEPS + 1, :3, :3],
        'L_UU': stages['L_UU'][: STEPS + 1],
        'g': path['value'][: STEPS + 1],
        'g_X': path['X'][: STEPS + 1, :, :3],
        'output_error': terminal['value'],
        'h_X': terminal['X'][:, :3],
    }
    for name, found in pairs.items():
        np.testing.assert_array_equal(found, getattr(lin, name), err_msg=name)
    np.testing.assert_array_equal(errors, lin.output_error)
    np.testing.assert_array_equal(g[: STEPS + 1], lin.g)
