"""Recorded drives that can be tampered with before they are written to a bag."""

import copy
from collections import deque
from dataclasses import dataclass, field, replace

import numpy as np
from bag_messages import (
    PATH,
    SECOND,
    STAMPED,
    all_parameters,
    cloud,
    grid,
    header,
    make,
    odometry,
    parameter_event,
    twist,
    write_bag,
)

from cmpsp_ros.bags.audit import CheckOutcome
from cmpsp_ros.bags.decision_record import DECISION, decision_message, path_message
from cmpsp_ros.guidance import GuidanceLaw, Observation
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file

START = 1_700_000_000 * SECOND
ODOM_PERIOD = SECOND // 50
LATENCY = 4_000_000
AGAIN = 60 * SECOND  # time until messages of a drive are received once more


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
    """Contents of a bag; everything in it may be changed."""

    parameters: dict
    odometry: list[Sample] = field(default_factory=list)
    commands: list[Command] = field(default_factory=list)
    decisions: list = field(default_factory=list)
    changes: list = field(default_factory=list)
    restarts: list = field(default_factory=list)
    sightings: list = field(default_factory=list)
    scans: list = field(default_factory=list)
    obstacles: list = field(default_factory=list)
    people: list = field(default_factory=list)
    truth: list[Sample] = field(default_factory=list)
    other: list[Sample] = field(default_factory=list)  # the path of a robot /r2
    other_frame_id: str = 'odom'
    sim: dict = field(default_factory=dict)
    frame_id: str = 'odom'
    namespace: str = ''
    stamped: bool = False
    odom: str = 'odom'
    cmd_vel: str = 'cmd_vel'
    records: list = field(default_factory=list)  # further ones: topic, time of reception, message

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

    def again(self):
        """The same drive, and once more after time has jumped back, without decisions."""
        drive, other = self.copy(), self.copy()
        for each in (*other.odometry, *other.commands):
            each.received += AGAIN
        drive.odometry += other.odometry
        drive.commands += other.commands
        drive.decisions = []
        return drive

    def write(self, path):
        node, sim = f'{self.namespace}/guidance', {f'{self.namespace}/sim': self.sim}
        given = {node: self.parameters} if self.parameters and not self.restarts else {}
        kinds = {f'{node}/decision': DECISION, f'{node}/predicted_path': PATH}
        kinds = kinds if self.decisions else {}
        return write_bag(path, self._records(node), given | (sim if self.sim else {}), kinds)

    def _records(self, node):
        """Records, topic by topic."""
        prefix, changes = self.namespace, '/parameter_events'
        own, frames = f'{prefix}/{self.odom}', {'/r2/odom': self.other_frame_id}
        around = {own: self.odometry, f'{prefix}/sim/truth': self.truth, '/r2/odom': self.other}
        for topic, samples in around.items():
            frame_id = frames.get(topic, self.frame_id)
            for each in samples:
                # What odometry says about its speed is not to be trusted.
                motion, spread = (99.0, -99.0), each.spread
                said = odometry(each.stamp, each.pose, motion, frame_id, spread)
                yield topic, each.received, said
        for each in self.commands:
            said = twist(*each.twist)
            if self.stamped:
                said = make(STAMPED, header(each.stamp, 'base_link'), said)
            yield f'{prefix}/{self.cmd_vel}', each.received, said
        for each in self.decisions:
            received = each.stamp + LATENCY
            yield f'{node}/decision', received, decision_message(each, node)
            if each.plan is not None:
                planned = path_message(each.plan, 'odom', each.stamp)
                yield f'{node}/predicted_path', received, planned
        for topic, clouds in (('moving_obstacles', self.obstacles), ('sim/people', self.people)):
            for stamp, *said in clouds:
                yield f'{prefix}/{topic}', stamp, cloud(stamp, *said)
        for stamp, cells, *origin in self.sightings:
            yield f'{node}/sighting', stamp, grid(stamp, cells, *origin)
        for stamp, scan in self.scans:
            yield f'{prefix}/scan', stamp, scan
        for stamp, key, value in self.changes:
            yield changes, stamp, parameter_event(node, {key: value}, stamp)
        for since, values in [(START, self.parameters), *self.restarts] if self.restarts else ():
            yield f'{node}/parameters', since, all_parameters(node, values, since)
        yield from self.records


def drive_case(preset='case3', rest=0.4, **changes):
    """Let the guidance law drive its own robot, and stand still for a while.

    Its `actuation_delay` must be a whole number of odometry periods.
    """
    given = {**load_parameter_file(preset), **changes}
    values = TABLE.resolve(given)
    settings = guidance_settings(values)
    # Where it goes must not depend on what the law makes of its choices.
    solver = replace(settings.solver, candidates=1, initial_iterations=2)
    law = GuidanceLaw(replace(settings, solver=solver), settings.world)
    drive = Drive(values)
    pose, held = np.array(values['initial_pose']), np.zeros(2)
    under_way, delay = deque(), round(values['actuation_delay'] * SECOND)
    stamp, end = START, START + round((settings.final_time + rest) * SECOND)
    while stamp <= end:
        drive.odometry.append(Sample(stamp + 1_000_000, stamp, pose))
        decision = law.step(Observation(stamp, pose))
        if decision is not None:
            drive.decisions.append(decision._replace(phases={'step': 2.5 + 0.1 * (stamp % 7)}))
            drive.commands.append(Command(stamp + LATENCY, stamp, decision.twist))
            steering = [] if decision.steering_angle is None else [decision.steering_angle]
            under_way.append((stamp + delay, np.append(decision.wheel_speeds, steering)))
        while under_way and under_way[0][0] <= stamp:
            _, held = under_way.popleft()
        pose = settings.robot.roll_out(pose, held[None], np.array([ODOM_PERIOD / SECOND]))[-1]
        stamp += ODOM_PERIOD
    return drive


def failed(findings):
    """Names of the checks that failed."""
    return {name for name, each in findings.items() if each.outcome is CheckOutcome.FAILED}


def drive_settings(drive):
    """Settings of a drive, as the law had them."""
    return guidance_settings(drive.parameters)
