"""What the guidance law decides at a control step, and how sure it is."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum
from types import MappingProxyType
from typing import Final, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.goals import Goal
from cmpsp_ros.guidance.horizon import Horizon
from cmpsp_ros.guidance.messages.tracks import MovingObject

UNTIMED: Final[Mapping[str, float]] = MappingProxyType({})


class FallbackLevel(IntEnum):
    """What is commanded, from best to last; the previous plan is the last audited one, shifted."""

    NOMINAL = 0
    ELASTIC = 1
    PREVIOUS_PLAN = 2
    STOP = 3


class Plan(NamedTuple):
    """Controls over the horizon and the path they lead along.

    Attributes:
        horizon: When each control is given.
        controls: Of the robot, shape ``(N + 1, r)``.
        poses: Predicted poses ``(N + 1, 3)`` [m, m, rad].
        delay: Time after which a control that is given takes effect [ns]; the first pose is where
            the robot will be then.
    """

    horizon: Horizon
    controls: Array
    poses: Array
    delay: int = 0

    def stamps(self, begin: int) -> list[int]:
        """When the robot should be at each pose [ns].

        Args:
            begin: When the first control is given [ns].
        """
        edges = self.horizon.edges
        stamps: list[int] = (edges + (begin + self.delay - int(edges[0]))).tolist()
        return stamps

    def pose_at(self, begin: int, stamp: int) -> list[float]:
        """Pose (x, y, heading) at an instant, between two samples on a straight line [m, m, rad].

        Args:
            begin: When the first control is given [ns].
            stamp: The instant [ns].
        """
        since = [each - stamp for each in self.stamps(begin)]
        return [float(np.interp(0.0, since, each)) for each in self.poses.T]


class Decision(NamedTuple):
    """Outcome of one control step.

    Attributes:
        stamp: Time stamp of the odometry that it answers [ns].
        step: Number of the control step, from 0.
        level: The fallback level.
        reason: Why that level, in a sentence.
        wheel_speeds: Commanded wheel speeds, shape ``(W,)``; of a differential drive right and left
            [rad/s].
        twist: The same as the speed and turn rate of a `Robot`, shape ``(2,)`` or ``(3,)``.
        time_left: Time to the final time [s]; 0 once it has passed, infinite where there is none.
        plan: The plan followed; None when stopped.
        terminal_error: Distance of the plan's end from the goal [m]; the robot's own once stopped.
            Where a road is followed the goal is a line across it.
        clearance: Least clearance from obstacles and road edges until the end of the coming control
            period, between samples too, the robot's own radius taken off [m].
        worst_clearance: The same along the whole plan [m].
        slack: Largest violation the relaxation left in the linearised constraints [m]; 0 unless
            elastic.
        iterations: C-MPSP iterations done.
        qp_iterations: Iterations of the QP back end in the last of them.
        active_rows: Constraints active in the last of them.
        failures: Failed control steps in a row, this one included.
        wheel_slip: Wheel-slip ratio that is estimated and compensated.
        wheel_lag: Lag of the wheels that is compensated, the least possible and the longest [s];
            None where none is considered.
        response_delay: Delay and lag of the response to commands that explains odometry, the least
            possible and the longest [s]; None while odometry agrees with `command_delay`.
        prediction_error: Bound of the distance of odometry from what was predicted for it [m]; 0 up
            to 2 mm.
        finished: Whether the final time has passed.
        missed: Whether it has passed with the robot farther from the goal than its tolerance.
        halted: Whether it answers no odometry but a call of `GuidanceLaw.halt`.
        cancelled: Whether it stops since the goal was cancelled, or none has come yet.
        braking: Whether it brakes along the audited path, for odometry was good a moment ago.
        late: How long it took, if it came too late to be sent; else 0 [s].
        pose: What it decided on (x, y, heading), where a transform led to the frame of the course
            or several nodes publish odometry [m, m, rad].
        skipped: Whether odometry that came before was passed over, for it had grown old.
        run: How often the law had been reset before it.
        revision: How often the law had been given new settings before it.
        tracks: Moving obstacles and plans of other robots, as they were known.
        sighting: Time stamp of what was known of the surroundings, where there are sensors [ns].
        goal: What it drives to, at which time; None where a road is followed.
        heading_error: Difference of the plan's last heading from the goal's [rad]; None where any
            will do.
        goals_received: How many goals were received since the run began.
        phases: Computing time by phase [ms], where a timer was given.
        steering_angle: Of a car; None of another robot [rad].
    """

    stamp: int
    step: int
    level: FallbackLevel
    reason: str
    wheel_speeds: Array
    twist: Array
    time_left: float
    plan: Plan | None
    terminal_error: float
    clearance: float
    worst_clearance: float
    slack: float = 0.0
    iterations: int = 0
    qp_iterations: int = 0
    active_rows: int = 0
    failures: int = 0
    wheel_slip: float = 0.0
    wheel_lag: tuple[float, float, float] | None = None
    response_delay: tuple[float, float, float] | None = None
    prediction_error: float = 0.0
    finished: bool = False
    missed: bool = False
    halted: bool = False
    cancelled: bool = False
    braking: bool = False
    late: float = 0.0
    pose: tuple[float, ...] | None = None
    skipped: bool = False
    run: int = 0
    revision: int = 0
    tracks: tuple[MovingObject, ...] = ()
    sighting: int | None = None
    goal: Goal | None = None
    heading_error: float | None = None
    goals_received: int = 0
    phases: Mapping[str, float] = UNTIMED
    steering_angle: float | None = None
