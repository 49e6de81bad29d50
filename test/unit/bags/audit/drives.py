"""Recorded drives that can be tampered with before they are written to a bag."""

from __future__ import annotations

import copy
from collections import deque
from dataclasses import dataclass, field, replace

import numpy as np

from cmpsp_ros.bags.audit import CheckOutcome
from cmpsp_ros.bags.definitions import jazzy
from cmpsp_ros.bags.messages import DECISION, PATH, TWIST, decision_message, path_message
from cmpsp_ros.bags.writer import BagWriter
from cmpsp_ros.guidance.law import GuidanceLaw
from cmpsp_ros.parameters.catalogue import TABLE
from cmpsp_ros.parameters.presets import load_parameter_file
from cmpsp_ros.parameters.settings import guidance_settings

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
ODOM_PERIOD = SECOND // 50
LATENCY = 4_000_000

ODOMETRY, STAMPED = 'nav_msgs/msg/Odometry', 'geometry_msgs/msg/TwistStamped'
EVENT = 'rcl_interfaces/msg/ParameterEvent'


@dataclass
class Sample:
    received: int
    stamp: int
    pose: np.ndarray
    spread: float = 0.0


@dataclass
class Command:
    received: int
    stamp: int
    twist: np.ndarray


@dataclass
class Drive:
    """What a bag is to hold; everything in it may be changed."""

    parameters: dict
    odometry: list[Sample] = field(default_factory=list)
    commands: list[Command] = field(default_factory=list)
    decisions: list = field(default_factory=list)
    changes: list = field(default_factory=list)
    restarts: list = field(default_factory=list)
    frame_id: str = 'odom'
    namespace: str = ''
    stamped: bool = False
    odom: str = 'odom'
    cmd_vel: str = 'cmd_vel'

    def copy(self):
        return copy.deepcopy(self)

    def at(self, seconds):
        """Index of the command of a time."""
        stamps = [each.stamp for each in self.commands]
        return int(np.searchsorted(stamps, START + round(seconds * SECOND)))

    def without_node(self):
        """The same drive as another program would have recorded it."""
        drive = self.copy()
        drive.parameters, drive.decisions = {}, []
        return drive

    def until(self, seconds):
        """The recording, ended early."""
        end = START + round(seconds * SECOND)
        drive = self.copy()
        drive.odometry = [each for each in drive.odometry if each.stamp <= end]
        drive.commands = [each for each in drive.commands if each.stamp <= end]
        drive.decisions = [each for each in drive.decisions if each.stamp <= end]
        return drive

    def later(self, seconds, run):
        """The same drive, some time later, as another run."""
        shift = round(seconds * SECOND)
        drive = self.copy()
        for each in (*drive.odometry, *drive.commands):
            each.received += shift
            each.stamp += shift
        drive.decisions = [
            each._replace(stamp=each.stamp + shift, run=run) for each in drive.decisions
        ]
        return drive

    def write(self, path):
        prefix = self.namespace
        with BagWriter(path) as bag:
            odom, cmd_vel = f'{prefix}/{self.odom}', f'{prefix}/{self.cmd_vel}'
            bag.topic(odom, ODOMETRY)
            bag.topic(cmd_vel, STAMPED if self.stamped else TWIST)
            for each in self.odometry:
                bag.write(odom, each.received, odometry(each, self.frame_id))
            for each in self.commands:
                bag.write(cmd_vel, each.received, command(each, stamped=self.stamped))
            if self.decisions:
                self._write_decisions(bag, f'{prefix}/guidance')
            if self.changes:
                bag.topic('/parameter_events', EVENT)
            for stamp, key, value in self.changes:
                bag.write(
                    '/parameter_events', stamp, event(stamp, f'{prefix}/guidance', key, value)
                )
            if self.parameters:
                bag.set_parameters(f'{prefix}/guidance', self.parameters)
            for since, parameters in self.restarts:
                bag.set_parameters(f'{prefix}/guidance', parameters, since)
        return path

    def _write_decisions(self, bag, node):
        bag.topic(f'{node}/decision', DECISION)
        bag.topic(f'{node}/predicted_path', PATH)
        for each in self.decisions:
            received = each.stamp + LATENCY
            bag.write(f'{node}/decision', received, decision_message(each, node))
            if each.plan is not None:
                raw = path_message(each.plan, 'odom', each.stamp)
                bag.write(f'{node}/predicted_path', received, raw)


def drive_case(preset='case3', rest=0.4, **changes):
    """Let the guidance law drive its own robot, and stand still for a while.

    Its `actuation_delay` must be a whole number of odometry periods.
    """
    given = {**load_parameter_file(preset), **changes}
    values = TABLE.resolve(given)
    settings = guidance_settings(values)
    # Where it goes must not depend on what the law makes of its choices.
    solver = replace(settings.solver, candidates=1, initial_iterations=2)
    law = GuidanceLaw(replace(settings, solver=solver))
    drive = Drive(values)
    pose, held = np.array(values['initial_pose']), np.zeros(2)
    under_way, delay = deque(), round(values['actuation_delay'] * SECOND)
    stamp, end = START, START + round((settings.final_time + rest) * SECOND)
    while stamp <= end:
        drive.odometry.append(Sample(stamp + 1_000_000, stamp, pose))
        decision = law.update(stamp, pose)
        if decision is not None:
            drive.decisions.append(decision._replace(phases={'step': 2.5 + 0.1 * (stamp % 7)}))
            drive.commands.append(Command(stamp + LATENCY, stamp, decision.twist))
            under_way.append((stamp + delay, decision.wheel_speeds))
        while under_way and under_way[0][0] <= stamp:
            _, held = under_way.popleft()
        pose = settings.robot.roll_out(pose, held[None], np.array([ODOM_PERIOD / SECOND]))[-1]
        stamp += ODOM_PERIOD
    return drive


def make(name, *fields):
    return jazzy().types[name](*fields)


def raw(message, name):
    return bytes(jazzy().serialize_cdr(message, name))


def header(stamp, frame_id):
    return make('std_msgs/msg/Header', time(stamp), frame_id)


def time(stamp):
    return make('builtin_interfaces/msg/Time', *divmod(stamp, SECOND))


def twist_message(speed, rate):
    vector = jazzy().types['geometry_msgs/msg/Vector3']
    return make(TWIST, vector(speed, 0.0, 0.0), vector(0.0, 0.0, rate))


def odometry(sample, frame_id):
    x, y, heading = map(float, sample.pose)
    placed = make(
        'geometry_msgs/msg/Pose',
        make('geometry_msgs/msg/Point', x, y, 0.0),
        make('geometry_msgs/msg/Quaternion', 0.0, 0.0, np.sin(heading / 2), np.cos(heading / 2)),
    )
    covariance = np.zeros(36)
    covariance[[0, 7, 35]] = sample.spread**2
    message = make(
        ODOMETRY,
        header(sample.stamp, frame_id),
        'base_link',
        make('geometry_msgs/msg/PoseWithCovariance', placed, covariance),
        # What odometry says about its speed is not to be trusted.
        make('geometry_msgs/msg/TwistWithCovariance', twist_message(99.0, -99.0), covariance),
    )
    return raw(message, ODOMETRY)


def command(each, *, stamped):
    message = twist_message(*map(float, each.twist))
    if stamped:
        return raw(make(STAMPED, header(each.stamp, 'base_link'), message), STAMPED)
    return raw(message, TWIST)


def event(stamp, node, key, value):
    none = [False, 0, 0.0, '', *(np.zeros(0, dtype=kind) for kind in (np.uint8, bool, np.int64))]
    none += [np.zeros(0), []]
    fields = [*none]
    kind = 3 if isinstance(value, float) else 8
    fields[kind - 1] = value if kind == 3 else np.array(value)
    parameter_value = make('rcl_interfaces/msg/ParameterValue', kind, *fields)
    parameter = make('rcl_interfaces/msg/Parameter', key, parameter_value)
    return raw(make(EVENT, time(stamp), node, [], [parameter], []), EVENT)


def failed(findings):
    """Names of the checks that failed."""
    return {name for name, each in findings.items() if each.outcome is CheckOutcome.FAILED}


def drive_settings(drive):
    """Settings of a drive, as the law had them."""
    return guidance_settings(drive.parameters)
