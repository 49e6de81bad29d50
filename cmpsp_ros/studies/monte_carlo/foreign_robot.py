"""A robot outside of the simulator, with a wrong model in the law.

It shares no code with the simulator: a unicycle whose speed and turn rate lag behind the command,
advanced at the ticks of its own loop, which also publish odometry with the stamps of its own clock.
Messages and control steps take time, more on a busy computer; commands count from the next tick on.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import NANOSECONDS, Decision, GuidanceLaw, Observation
from cmpsp_ros.robots import Robot
from cmpsp_ros.simulator import Motion

_RATES = 20.0, 50.0
_LAGS = 0.05, 0.2
_OFFSETS = -0.05, 0.05
_TOLD_ERRORS = -0.1, 0.1
_BUSY = 0.0, 0.01
_STEP = 0.002, 0.008  # time of a control step on an idle computer [s]
_MESSAGE = 0.0005, 0.003  # time that a message takes [s]
_POSITION_STDDEV, _HEADING_STDDEV = 0.001, 0.001
_WATCHDOG = 0.5
_TO_REST = 1.5


@dataclass(frozen=True)
class ForeignRobot:
    """Properties of the robot, drawn for a run."""

    rate: float  # of its loop and its odometry [Hz]
    lag: float  # time constant of speed and turn rate [s]
    clock_offset: float  # lead of its clock over the computer's [s]
    told_error: float  # error of the `command_delay` given to the law [s]
    busy: float  # mean delay of a control step by other work [s]
    seed: int  # of latencies and noise

    @classmethod
    def draw(cls, seed: int, number: int) -> ForeignRobot:
        """The robot of a run."""
        random = np.random.default_rng([seed, number, 1])
        rate, lag, offset, error = (
            float(random.uniform(*each)) for each in (_RATES, _LAGS, _OFFSETS, _TOLD_ERRORS)
        )
        busy = float(random.choice(_BUSY))
        return cls(rate, lag, offset, error, busy, int(random.integers(2**31)))

    @property
    def delay(self) -> float:
        """Mean delay of its response to a command, lag included, half a tick less [s]."""
        latencies = (sum(each) / 2.0 for each in (_STEP, _MESSAGE, _MESSAGE))
        return self.lag + sum(latencies) + self.busy - 0.5 / self.rate

    @property
    def told(self) -> float:
        """`command_delay` given to the law [s]."""
        return max(self.delay + self.told_error, 0.0)


@dataclass
class _Unicycle:
    """State of the robot at a tick, as in its own program."""

    time: float
    x: float
    y: float
    heading: float
    speed: float = 0.0
    turn_rate: float = 0.0
    command: tuple[float, float] = (0.0, 0.0)
    heard: float = -math.inf

    def tick(self, lag: float, duration: float) -> None:
        """Advance by a tick: the velocities first, then the pose with them."""
        self.time += duration
        if self.time - self.heard > _WATCHDOG:
            self.command = 0.0, 0.0
        part = 1.0 - math.exp(-duration / lag)
        self.speed += part * (self.command[0] - self.speed)
        self.turn_rate += part * (self.command[1] - self.turn_rate)
        middle = self.heading + self.turn_rate * duration / 2.0
        self.x += self.speed * duration * math.cos(middle)
        self.y += self.speed * duration * math.sin(middle)
        self.heading += self.turn_rate * duration


class ForeignDrive:
    """A drive: the robot, the messages under way, and the law on a computer that takes its time."""

    def __init__(
        self, foreign: ForeignRobot, model: Robot, pose: tuple[float, float, float]
    ) -> None:
        self._foreign, self._model = foreign, model
        self._tick = 1.0 / foreign.rate
        self._random = np.random.default_rng(foreign.seed)
        began = 1.0 + float(self._random.uniform(0.0, 1.0 / foreign.rate))
        self._body = _Unicycle(began, *pose)
        self._odometry: deque[tuple[float, int, Array]] = deque()
        self._commands: deque[tuple[float, tuple[float, float]]] = deque()
        self._free_at = 0.0
        self.motions: list[Motion] = []  # pose and twist at each tick, by the robot's clock
        self.decisions: list[Decision] = []  # up to the final time
        self.end = 0  # the final time, by the robot's clock [ns]; 0 before the first decision

    def run(self, law: GuidanceLaw, period: float) -> None:
        """Drive, with a control period [s], until the robot is at rest after the final time."""
        self._note()
        while not self.end or self._stamp < self.end + round(_TO_REST * NANOSECONDS):
            body, duration = self._body, self._tick
            while self._commands and self._commands[0][0] <= body.time + duration:
                body.heard, body.command = self._commands.popleft()
            begin = np.array([body.x, body.y, body.heading])
            body.tick(self._foreign.lag, duration)
            self._note(begin)
            noise = self._random.standard_normal(3)
            noise *= _POSITION_STDDEV, _POSITION_STDDEV, _HEADING_STDDEV
            pose = np.array([body.x, body.y, body.heading]) + noise
            arrival = body.time + self._random.uniform(*_MESSAGE)
            self._odometry.append((arrival, self._stamp, pose))
            self._guide(law, period, body.time + duration)

    @property
    def _stamp(self) -> int:
        return round((self._body.time + self._foreign.clock_offset) * NANOSECONDS)

    def _note(self, begin: Array | None = None) -> None:
        """Note the arc that the robot has driven since the last tick, split at the final time."""
        stamp, body = self._stamp, self._body
        if begin is not None:
            twist = np.array([body.speed, body.turn_rate])
            wheels = self._model.wheel_speeds(twist)
            since = self.motions.pop().stamp_ns
            self.motions.append(Motion(since, begin, wheels, twist))
            if since < self.end < stamp:
                control, held = self._model.controls(twist)[None], (self.end - since) / NANOSECONDS
                there = self._model.roll_out(begin, control, np.array([held]))[-1]
                self.motions.append(Motion(self.end, there, wheels, twist))
        rest = np.zeros(2)
        pose = np.array([body.x, body.y, body.heading])
        self.motions.append(Motion(stamp, pose, self._model.wheel_speeds(rest), rest))

    def _guide(self, law: GuidanceLaw, period: float, until: float) -> None:
        """Let the computer work off the odometry that it can take up before an instant [s]."""
        while self._odometry and max(self._odometry[0][0], self._free_at) < until:
            arrival, stamp, pose = self._odometry.popleft()
            begin = max(arrival, self._free_at)
            if begin - arrival > period and law.is_due(stamp) and self._odometry:
                _, stamp, pose = self._odometry[-1]
                self._odometry.clear()
            decision = law.step(Observation(stamp, pose))
            if decision is None:
                continue
            took = self._random.uniform(*_STEP) + self._random.exponential(self._foreign.busy)
            is_late = took > period and decision.plan is not None
            decision = law.after_step(took if is_late else 0.0)
            self._free_at = begin + took
            self.end = law.ends_at or 0
            if not decision.late:
                heard = self._free_at + self._random.uniform(*_MESSAGE)
                self._commands.append((heard, (float(decision.twist[0]), float(decision.twist[1]))))
            if not decision.finished:
                self.decisions.append(decision)
