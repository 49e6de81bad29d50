"""After the preparation nothing is compiled, nor loaded, whatever a run may bring."""

import math
import os
import subprocess
import sys
from dataclasses import replace

import pytest
from scenarios import law_of

from cmpsp_ros.guidance import Observation
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file

PERIOD = 200_000_000

# In a process of its own: nothing that other tests have run may be there already.
PROGRAM = """
import gc
import math
import sys
from itertools import product

import numpy as np
from numba.core.dispatcher import Dispatcher

from cmpsp_ros.guidance.law import GuidanceLaw
from cmpsp_ros.guidance.prediction.estimator import Observation
from cmpsp_ros.guidance.warmup import prepare
from cmpsp_ros.mpsp.qp.active_set.records import Space
from cmpsp_ros.mpsp.qp.riccati import Outcome
from cmpsp_ros.parameters.catalogue import TABLE
from cmpsp_ros.parameters import load_parameter_file
from cmpsp_ros.parameters.settings import guidance_settings


def law_of(settings):
    return GuidanceLaw(settings, settings.world)


def code():
    dispatchers = [each for each in gc.get_objects() if isinstance(each, Dispatcher)]
    ours = [each for each in dispatchers if each.__module__.startswith('cmpsp_ros')]
    return {(each.__module__, each.__name__, str(sig)) for each in ours for sig in each.signatures}


limits = 'robot.max_wheel_acceleration', 'robot.max_wheel_jerk'
given = {'solver.candidates': 1, **dict(zip(limits, map(float, sys.argv[1:]), strict=True))}
values = TABLE.resolve(load_parameter_file('case3') | given)
prepare(guidance_settings(values))
before = code()
assert before

START, PERIOD = np.array([0.0, -9.25, 0.0]), 200_000_000
JUMPS = {
    'none': np.zeros(3),
    'off the road': np.array([4.0, 0.0, 0.0]),
    'into an obstacle': np.array([8.0, 3.25, 0.0]),
    'about': np.array([0.0, 0.0, math.pi]),
}
levels = set()
changes = product(
    ('gauss_newton', 'projected', 'exact'),
    (0.0, 30.0, 51.0),
    (True, False),
    (0.0, 0.13),
)
for hessian, limit, between, delay in changes:
    changed = {
        'solver.hessian': hessian,
        'robot.max_wheel_speed': limit,
        'safety.between_samples': between,
        'command_delay': delay,
        'max_wheel_lag': delay,
        'obstacles.a.radius': 1.0,
        'solver.candidates': 4,
    }
    law = law_of(guidance_settings(values))
    law.step(Observation(0, START))
    other = guidance_settings(TABLE.reconfigure(values, changed))
    law.reconfigure(other, other.world)
    for step, jump in enumerate(JUMPS.values(), 1):
        for stamp in (3 * step * PERIOD, (3 * step + 1) * PERIOD + PERIOD // 3):
            levels.add(law.step(Observation(stamp, START + jump)).level.name)
    law.halt(20 * PERIOD, 'Enough.')
    law.step(Observation(50 * PERIOD - PERIOD // 2, START))
    assert law.step(Observation(50 * PERIOD, START)).finished
assert levels >= {'NOMINAL', 'ELASTIC'}, levels

# Where the active set gives up, the general iteration has Clarabel's answers.
def general(radius):
    changed = {'solver.hessian': 'exact', 'obstacles.a.radius': radius}
    law = law_of(guidance_settings(TABLE.reconfigure(values, changed)))
    found = [law.step(Observation(step * PERIOD, START)) for step in range(2)]
    return [each.level.name for each in found], [each.wheel_speeds for each in found]


own = [general(radius) for radius in (1.0, 2.0)]
asked = []
Space.solve = lambda *_: asked.append(1) or Outcome.ITERATION_LIMIT
for radius, (levels, speeds) in zip((1.0, 2.0), own, strict=True):
    found = general(radius)
    assert found[0] == levels, (found, levels)
    # With a limit the multipliers are not unique, nor are the step lengths that they lead to.
    if not given['robot.max_wheel_acceleration']:
        np.testing.assert_allclose(found[1], speeds, atol=1e-5)
assert asked
print(*sorted(code() - before), sep='\\n')
"""


@pytest.mark.ros
def test_a_node_that_needs_no_spline_starts_without_scipy():
    """To import its interpolation takes a third of what a start takes in all."""
    code = 'import sys, cmpsp_ros.nodes.guidance.node; '
    code += "print('scipy.interpolate' in sys.modules)"
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == 'False'


@pytest.mark.slow
@pytest.mark.parametrize('limits', ['0 0', '100 0', '100 400'])
def test_no_code_is_missing_after_it(limits):
    done = subprocess.run(
        [sys.executable, '-c', PROGRAM, *limits.split()], capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == []


SENSING = """
from scanned_rooms import ScannedRoom, straight

from cmpsp_ros.guidance.warmup import run_sensing
from cmpsp_ros.mpsp.jit import kernel_folder
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file


def files():
    found = kernel_folder().glob('cmpsp_ros.sensing.*')
    return {each.name: each.read_bytes() for each in found}


run_sensing(guidance_settings(TABLE.resolve(load_parameter_file('people'))))
before = files()
assert before
room = ScannedRoom(walkers=[straight(4.0, 1.0, 0.0, 0.8), straight(6.0, 5.0, 0.0, -0.5)])
assert max(len(seen.tracks) for _, seen in room.run(5.0)) == 2
after = files()
print(*(name for name in after if after[name] != before.get(name)))
"""


@pytest.mark.slow
def test_people_who_come_and_go_are_no_reason_to_compile(tmp_path, monkeypatch):
    """A kernel that others have called may still lack what Python calls."""
    monkeypatch.setenv('NUMBA_CACHE_DIR', str(tmp_path))
    monkeypatch.setenv('PYTHONPATH', os.pathsep.join(sys.path))
    command = [sys.executable, '-c', SENSING]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.stdout.split(), done.stderr) == ([], '')


def test_a_solver_that_rounding_leads_round_comes_to_an_end():
    """Off the road, with the exact Hessian and no wheel limit, hundreds of rows are active."""
    given = guidance_settings(TABLE.resolve(load_parameter_file('case1')))
    solver = replace(given.solver, hessian='exact')
    robot = replace(given.robot, max_wheel_speed=math.inf)
    law = law_of(replace(given, solver=solver, robot=robot))
    poses = (given.road.middle(), given.road.middle(), given.road.beside(), given.road.beside())
    decisions = [law.step(Observation(step * PERIOD, pose)) for step, pose in enumerate(poses)]
    assert all(each.reason for each in decisions)
