"""Custom models: the example of doc/user/your_model.md, and what cannot be used."""

import math
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cmpsp_ros.parameters import TABLE, ParameterError, guidance_settings, load_parameter_file
from cmpsp_ros.robots import Ackermann, Omnidirectional
from cmpsp_ros.robots.motion import arc_part, arc_under

ROOT = Path(__file__).parents[3]
PAGE = (ROOT / 'doc' / 'user' / 'your_model.md').read_text(encoding='utf-8')
FORK_LIFT = re.search(r'^```python\n(.*?)^```$', PAGE, re.MULTILINE | re.DOTALL)[1]

# Models that are there already, and one that has three controls.
OTHERS = """
class Car(ForkLift):
    limits = 2.0, 0.5
    constants = (0.3,)

    @staticmethod
    def motion(constants, speed, angle):
        return speed, 0.0, speed * np.tan(angle) / constants[0]

    @staticmethod
    def steer(constants, forward, left, turn_rate):
        return forward, math.atan(constants[0] * turn_rate / forward) if forward != 0.0 else 0.0


class Bike(ForkLift):
    # Its reference point is ahead of the rear axle.
    limits = 1.2, 0.7
    constants = 1.1, 0.3

    @staticmethod
    def motion(constants, speed, angle):
        turn_rate = speed * np.tan(angle) / constants[0]
        return speed, constants[1] * turn_rate, turn_rate

    @staticmethod
    def steer(constants, forward, left, turn_rate):
        return forward, math.atan(constants[0] * turn_rate / forward) if forward != 0.0 else 0.0


class Platform(CustomRobot):
    n_controls, n_speeds = 3, 3
    drives_sideways = True
    constants = ()
    change_limits = math.inf, math.inf, math.inf

    @property
    def limits(self):
        return (self.parameters['robot.max_wheel_speed'],) * 3

    @staticmethod
    def motion(constants, forward, left, turn_rate):
        return forward, left, turn_rate

    @staticmethod
    def steer(constants, forward, left, turn_rate):
        return forward, left, turn_rate
"""

WRONG = """
from forklift import ForkLift, CustomRobot, math, np

class NoBase:
    pass

class NoMotion(CustomRobot):
    n_controls = 2
    limits = change_limits = 1.0, 1.0
    constants = ()

class NoLimit(ForkLift):
    limits = 1.5, 0.0

class OneLimit(ForkLift):
    limits = (1.5,)

class Degrees(ForkLift):
    limits = 1.5, 40.0

class NoTuple(ForkLift):
    limits = 1.5

class NegativeChange(ForkLift):
    change_limits = 1.0, -1.0

class Four(ForkLift):
    n_controls = 4

class Kinked(ForkLift):
    @staticmethod
    def motion(constants, speed, angle):
        return abs(speed) * np.cos(angle), 0.0, speed * np.sin(angle) / constants[0]

class ForwardsOnly(ForkLift):
    @staticmethod
    def motion(constants, speed, angle):
        ahead = np.maximum(speed, 0.0)
        return ahead * np.cos(angle), 0.0, ahead * np.sin(angle) / constants[0]

class TwoParts(ForkLift):
    @staticmethod
    def motion(constants, speed, angle):
        return speed, speed * np.sin(angle) / constants[0]

class OfList(ForkLift):
    @staticmethod
    def motion(constants, speed, angle):
        return [speed * np.cos(angle), 0.0, speed * np.sin(angle) / constants[0]]

class OneControl(ForkLift):
    @staticmethod
    def steer(constants, forward, left, turn_rate):
        return (forward,)

class NotInReverse(ForkLift):
    @staticmethod
    def steer(constants, forward, left, turn_rate):
        speed, angle = ForkLift.steer(constants, forward, left, turn_rate)
        return abs(speed), angle

class NeverSideways(ForkLift):
    drives_sideways = True

class OfMath(ForkLift):
    @staticmethod
    def motion(constants, speed, angle):
        return speed * math.cos(angle), 0.0, speed * math.sin(angle) / constants[0]

class OtherSteering(ForkLift):
    @staticmethod
    def steer(constants, forward, left, turn_rate):
        return forward, constants[0] * turn_rate
"""


@pytest.fixture(scope='module')
def modules(tmp_path_factory):
    """A folder of modules that can be imported."""
    folder = tmp_path_factory.mktemp('models')
    (folder / 'forklift.py').write_text(FORK_LIFT + OTHERS)
    (folder / 'wrong.py').write_text(WRONG)
    sys.path.insert(0, str(folder))
    yield folder
    sys.path.remove(str(folder))
    for name in ('forklift', 'wrong'):
        sys.modules.pop(name, None)


def settings_of(model, preset='case3_wide', **changes):
    given = load_parameter_file(preset) | {'robot.model': model, 'initial_guess.type': 'road'}
    return guidance_settings(TABLE.resolve({**given, **changes}))


def check(robot, controls, durations):
    """Steps and derivatives against finite differences."""
    poses = robot.roll_out(np.array([1.0, -2.0, 0.4]), controls, durations)
    A, B = robot.jacobians(poses, controls, durations)
    for k, (pose, control, time) in enumerate(zip(poses[:-1], controls, durations, strict=True)):

        def end(pose, control, time=time):
            return robot.roll_out(pose, control[None], np.array([time]))[-1]

        for i, each in enumerate(1e-6 * np.eye(3)):
            change = (end(pose + each, control) - end(pose - each, control)) / 2e-6
            np.testing.assert_allclose(A[k][:, i], change, atol=1e-8)
        for i, each in enumerate(1e-6 * np.eye(robot.n_controls)):
            change = (end(pose, control + each) - end(pose, control - each)) / 2e-6
            np.testing.assert_allclose(B[k][:, i], change, atol=1e-8)


def test_the_fork_lift_of_the_page(modules):
    robot = settings_of('forklift:ForkLift').robot
    controls = np.array([[1.0, 0.6], [-0.7, 0.0], [1e-3, -1.1], [0.0, 0.3]])
    check(robot, controls, np.array([0.5, 0.2, 1.0, 0.1]))
    np.testing.assert_allclose(robot.controls(robot.twist(controls[:3])), controls[:3])
    assert robot.half_track == pytest.approx(0.8 / math.tan(1.2))
    assert robot.max_acceleration == pytest.approx(2.0)
    slower = robot.slipping(0.1)
    np.testing.assert_allclose(slower.twist(controls), 0.9 * robot.twist(controls))
    check(slower, controls, np.array([0.5, 0.2, 1.0, 0.1]))
    np.testing.assert_array_equal(robot.stopped(controls[0]), [0.0, 0.6])
    assert [
        (each.name, each.axis, each.values.tolist(), each.limit)
        for each in robot.signals(robot.twist(np.array([[1.0, 0.6], [-0.5, -0.2]])))
    ] == [
        ('speed', 'speed', pytest.approx([1.0, -0.5]), 1.5),
        ('angle', 'angle', pytest.approx([0.6, -0.2]), 1.2),
    ]
    # An angle counts as it moves the robot: nearly at rest odometry does not show it.
    fast, slow = (robot.twist(np.array([[v, 0.6], [v, 0.0]])) for v in (1.5, 1e-3))
    assert robot.wheel_differences(fast[:1], fast[1:]) == pytest.approx(0.5)
    assert robot.wheel_differences(slow[:1], slow[1:]) < 1e-3


def test_a_reference_point_that_turns_move_sideways(modules):
    robot = settings_of('forklift:Bike').robot
    assert not robot.drives_sideways
    controls, durations = np.array([[1.0, 0.6], [-0.7, 0.2]]), np.array([1.0, 0.5])
    check(robot, controls, durations)
    twists = robot.twist(controls)
    np.testing.assert_allclose(twists[:, 1], 0.3 * twists[:, 2])
    np.testing.assert_allclose(robot.controls(twists), controls)
    # What is audited is the path that is driven.
    poses = robot.roll_out(np.zeros(3), controls, durations)
    ends = [arc_part(arc_under(poses, twists, k, durations[k]), 1.0)[:2] for k in range(2)]
    np.testing.assert_allclose(ends, poses[1:, :2], atol=1e-12)


def test_models_that_are_there_are_driven_alike(modules):
    random = np.random.default_rng(1)
    durations = random.uniform(0.05, 0.5, 20)
    car = Ackermann(wheel_base=0.3, max_steering_angle=0.5, wheel_radius=1.0, max_wheel_speed=2.0)
    base = Omnidirectional.mecanum(0.2, 0.2, wheel_radius=0.05, max_wheel_speed=40.0)
    for mine, its in (('Car', car), ('Platform', base)):
        names = ['a', 'b', 'c'][: its.n_controls]
        robot = settings_of(f'forklift:{mine}', **{'robot.joint_names': names}).robot
        controls = random.uniform(-0.5, 0.5, (20, its.n_controls))
        # Their controls for the same twists are linear in each other.
        to_its = its.controls(np.eye(3)) if its.drives_sideways else np.eye(2)
        found = robot.roll_out(np.zeros(3), controls, durations)
        poses = its.roll_out(np.zeros(3), controls @ to_its, durations)
        np.testing.assert_allclose(found, poses, atol=1e-13)
        A, B = robot.jacobians(poses, controls, durations)
        its_A, its_B = its.jacobians(poses, controls @ to_its, durations)
        np.testing.assert_allclose(A, its_A, atol=1e-13)
        for one, other in zip(B, its_B, strict=True):
            np.testing.assert_allclose(one, other @ to_its.T, atol=1e-13)


@pytest.mark.parametrize(
    ('model', 'said'),
    [
        ('hovercraft', "found 'hovercraft', wanted differential_drive, mecanum"),
        ('no_such_module:Robot', 'no_such_module'),
        ('forklift:Missing', "no 'Missing' in forklift"),
        ('wrong:NoBase', 'derived from cmpsp_ros.robots.CustomRobot'),
        ('wrong:NoMotion', 'abstract'),
        ('wrong:NoLimit', r'limits \(1.5, 0.0\), wanted 2 numbers above 0'),
        ('wrong:OneLimit', r'limits \(1.5,\)'),
        ('wrong:NegativeChange', r'change_limits \(1.0, -1.0\)'),
        ('wrong:Four', 'n_controls 4'),
        ('wrong:Kinked', 'motion has derivatives'),
        ('wrong:OfMath', 'TypeError: must be real number, not complex'),
        ('wrong:OtherSteering', 'of which steer answers'),
        ('wrong:Degrees', r'limits \(1.5, 40.0\), wanted .*, of angles at most pi'),
        ('wrong:NoTuple', r'limits 1.5, wanted 2 numbers above 0'),
        ('wrong:ForwardsOnly', 'motion has derivatives'),
        ('wrong:TwoParts', 'motion answers .*, wanted speed forward, speed to the left, turn rate'),
        ('wrong:OfList', 'OfList, which raises .*Error: '),
        ('wrong:OneControl', r'steer answers \(.*,\), wanted 2 controls'),
        ('wrong:NotInReverse', 'wanted the controls of that twist'),
        ('wrong:NeverSideways', 'no speed to the left'),
    ],
)
def test_a_model_that_cannot_be_used_is_an_error_of_its_key(modules, model, said):
    with pytest.raises(ParameterError, match=said) as raised:
        settings_of(model)
    assert str(raised.value).startswith('robot.model: found')


# What they call takes long to compile: by one worker.
@pytest.mark.xdist_group('cars')
@pytest.mark.parametrize('model', ['ForkLift', 'Platform'])
def test_it_drives_a_course_within_its_limits(modules, model):
    """In a process of its own: a second one finds everything compiled."""
    script = f"""
import sys
sys.path[:0] = [{str(modules)!r}, {str(ROOT / 'test' / 'unit' / 'guidance')!r}]
import numpy as np
from models import assert_arrives, assert_the_same, drive
from cmpsp_ros.mpsp.jit.watch import compilations

ITS = 'displace', 'differentiate', 'put_controls', 'motion', 'steer'
given = 'robot.model=forklift:{model}', 'initial_guess.type=road', 'robot.radius=0.4'
limits = 'robot.max_wheel_speed=1.5', 'final_time=15.0', 'solver.work_share=0.3'
three = ['robot.joint_names=[a, b, c]'] * ('{model}' == 'Platform')
run = drive('case3_wide', *given, *limits, *three)
assert_arrives(*run)
with compilations() as compiled:
    assert_the_same(run, drive('case3_wide', *given, *limits, *three))
assert compiled == [], compiled
if '{model}' == 'ForkLift':
    # Another model compiles what is its own, and nothing else.
    with compilations() as compiled:
        drive('case3_wide', 'robot.model=forklift:Car', *given[1:], *limits)
    others = [each for each in compiled if each.rpartition('.')[2] not in ITS]
    assert others == [], compiled
settings, decisions = run[:2]
parts = np.array([each.wheel_speeds for each in decisions])
changes = np.abs(np.diff(parts * settings.robot.bounds, axis=0, prepend=0.0)).max(axis=0)
assert np.abs(parts).max() <= 1.0
most = np.array(settings.robot.change_limits) * settings.control_period
assert (changes <= most + 1e-6).all(), changes
"""
    done = subprocess.run(
        [sys.executable, '-c', script], capture_output=True, text=True, timeout=500, check=False
    )
    assert done.returncode == 0, done.stderr
