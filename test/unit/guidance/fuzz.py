"""Odometry of every kind: a command is safe, or the robot is told to stop and why."""

import math
from collections import Counter
from dataclasses import dataclass, replace

import hypothesis
import numpy as np
from hypothesis import HealthCheck, Phase, given
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from rclpy.time import Time
from scenarios import FIRST, PAPER, ROAD, SECOND, START, reconfigure, settings

from cmpsp_ros.guidance import FallbackLevel, GuidanceLaw, Observation, Safety, Weights
from cmpsp_ros.guidance.messages import Arrival, OdometryError, OdometryGate, OdometryReading
from cmpsp_ros.sensing import stamp_of

SECOND_NS = 1_000_000_000
PIECES = 50

SETTINGS = (
    settings((FIRST, SECOND), 51.0, ROAD),
    settings((FIRST, SECOND), 51.0, PAPER, final_time=2.0),
    settings((FIRST,), 45.0, ROAD, robot_radius=0.1, safety=Safety(margin=0.05)),
    settings((SECOND,), guess=ROAD),
    settings((FIRST, SECOND), 51.0, ROAD, command_delay=0.06),
    settings((), 5.0, ROAD, weights=Weights(control_rate=1.0)),
    settings((FIRST, SECOND), 51.0, ROAD, failure_tolerance=1, final_time=3.3),
)

anything = st.floats() | st.sampled_from([0.0, 1e-300, 1e16, 1e300, math.inf, -math.inf, math.nan])


@dataclass(frozen=True)
class Event:
    """Something that comes to the node after some time.

    Attributes:
        after: Time since the event before [ns]; may be negative, as after a restarted clock.
        place: Where the robot is said to be: None for where it is, else x, y, heading.
        error: What is added to it.
        turn: Orientation instead, as a quaternion.
        frame: Frame of the odometry.
        age: By how much its stamp is older than the clock [ns].
        what: Odometry, or something else that happens at that time.
    """

    after: int
    place: tuple[float, float, float] | None
    error: tuple[float, float, float]
    turn: tuple[float, float, float, float] | None
    frame: str
    age: int
    what: str


def mostly(usual, *others):
    """Strategies of which the first is drawn about nine times out of ten."""
    return st.integers(0, 19).flatmap(lambda n: usual if n < 18 else st.one_of(*others))


near = st.floats(-0.05, 0.05)
events = st.builds(
    Event,
    after=mostly(
        st.sampled_from([200_000_000, 20_000_000, 0]),
        st.integers(0, 2 * SECOND_NS),
        st.integers(-20 * SECOND_NS, 20 * SECOND_NS),
    ),
    place=mostly(
        st.none(),
        st.tuples(st.floats(-12.0, 12.0), st.floats(-12.0, 12.0), st.floats(-4.0, 4.0)),
        st.tuples(anything, anything, st.floats(-4.0, 4.0)),
    ),
    error=mostly(st.just((0.0, 0.0, 0.0)), st.tuples(near, near, near)),
    turn=mostly(st.none(), st.tuples(anything, anything, anything, anything)),
    frame=mostly(st.just('odom'), st.sampled_from(['', 'map', 'odom ', '/odom'])),
    age=mostly(st.just(0), st.integers(-2 * SECOND_NS, 2 * SECOND_NS)),
    what=mostly(st.just('odometry'), st.sampled_from(['silence', 'reset', 'reconfigure'])),
)
streams = st.tuples(st.integers(0, len(SETTINGS) - 1), st.lists(events, min_size=1, max_size=20))


def message_of(event, pose, stamp):
    """The odometry of an event, as ROS has it."""
    said = Odometry()
    said.header.stamp = Time(nanoseconds=stamp).to_msg()
    said.header.frame_id = event.frame
    x, y, heading = pose if event.place is None else event.place
    said.pose.pose.position.x = float(x + event.error[0])
    said.pose.pose.position.y = float(y + event.error[1])
    half = (heading + event.error[2]) / 2.0
    turn = said.pose.pose.orientation
    turn.x, turn.y, turn.z, turn.w = event.turn or (0.0, 0.0, math.sin(half), math.cos(half))
    return said


class Drive:
    """A node's way with odometry, without its topics, and the robot under its commands."""

    def __init__(self, number):
        self.given = SETTINGS[number]
        self.law, self.gate = GuidanceLaw(self.given, self.given.world), OdometryGate()
        self.pose, self.held = np.array(START), np.zeros(2)
        self.now, self.outcomes = 100 * SECOND_NS, Counter()

    def meet(self, event):
        duration = np.array([max(event.after, 0) / 1e9])
        self.pose = self.given.robot.roll_out(self.pose, self.held[None], duration)[-1]
        self.now = max(0, self.now + event.after)
        if event.what == 'silence':
            self.gate.fail('No usable odometry.')
            self.halt()
        elif event.what == 'reset':
            self.law.reset()
            self.gate = OdometryGate()
        elif event.what == 'reconfigure':
            self.given = replace(self.given, obstacles=self.given.obstacles[:1])
            reconfigure(self.law, self.given)
        else:
            self.hear(message_of(event, self.pose, max(0, self.now - event.age)))

    def hear(self, message):
        try:
            pose, stamp = OdometryReading.of(message).pose_in('odom'), stamp_of(message)
            arrival = self.gate.take(stamp, pose, self.now, self.given)
        except OdometryError as error:
            self.outcomes['refused'] += 1
            self.gate.refuse(str(error))
        else:
            if arrival is Arrival.IGNORED:
                self.outcomes['ignored'] += 1
                return
            if arrival is Arrival.TIME_JUMPED_BACK:
                self.law.reset()
        if self.gate.fault:
            self.halt()
            return
        decision = self.law.step(Observation(stamp, pose))
        if decision is None:
            self.outcomes['not due'] += 1
        else:
            self.note(decision, pose)

    def halt(self):
        self.gate.note_stop()
        self.note(self.law.halt(self.now, self.gate.reason(self.given), braking=True), None)

    def note(self, decision, pose):
        """No command is beyond the limits, not finite, or leads anywhere it must not."""
        self.outcomes[decision.level.name.lower()] += 1
        self.held = decision.wheel_speeds
        assert decision.reason[-1] in '.?', decision.reason
        assert np.isfinite([*decision.wheel_speeds, *decision.twist]).all(), decision
        assert np.abs(decision.wheel_speeds).max() <= self.given.robot.max_wheel_speed
        if decision.level is FallbackLevel.STOP:
            assert not decision.wheel_speeds.any()
        elif self.given.command_delay == 0.0:
            self.check_arc(decision, pose)

    def check_arc(self, decision, pose):
        """Until the next decision nothing is touched, or at least not deeper than before."""
        duration = decision.plan.horizon.durations[0] / PIECES
        wheels, times = np.tile(decision.wheel_speeds, (PIECES, 1)), np.full(PIECES, duration)
        path = self.given.robot.roll_out(pose, wheels, times)
        away = clearances(path, self.given)
        assert (away.min(axis=0) >= np.minimum(away[0], 0.0) - 1e-6).all(), decision


def clearances(path, given):
    """Clearance of each place from both edges and all obstacles, by nothing but distances."""
    out = np.linalg.norm(path[:, :2] - given.road.center, axis=1)
    from_obstacles = [
        np.linalg.norm(path[:, :2] - each.center, axis=1) - each.radius for each in given.obstacles
    ]
    edges = [given.road.outer_radius - out, out - given.road.inner_radius]
    return np.column_stack([*edges, *from_obstacles]) - given.robot_radius


def fuzz(count, seed):
    """Try so many streams; returns what was decided in all of them."""
    outcomes = Counter()

    @hypothesis.seed(seed)
    @hypothesis.settings(
        max_examples=count,
        database=None,
        deadline=None,
        suppress_health_check=list(HealthCheck),
        # What fails is told as it was found: to make it smaller takes minutes.
        phases=[Phase.generate],
    )
    @given(streams)
    def attempt(stream):
        number, following = stream
        drive = Drive(number)
        for event in following:
            drive.meet(event)
        outcomes.update(drive.outcomes, streams=1)

    attempt()
    return dict(outcomes)
