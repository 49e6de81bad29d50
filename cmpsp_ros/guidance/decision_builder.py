"""What every decision tells beside what it decides: of the run, of the goal, how far it is."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.guidance.decision import Decision, Plan, Rung
from cmpsp_ros.guidance.horizon import NANOSECONDS, NEVER
from cmpsp_ros.guidance.mission.goal_manager import Itinerary
from cmpsp_ros.guidance.safety.audit import Verdict
from cmpsp_ros.robots.differential_drive import DifferentialDrive

Array = NDArray[np.float64]


class Account:
    """Makes the decisions of a law, and counts.

    Attributes:
        run: How often the law has been reset before.
        revision: How often it has been given new settings before.
        step: Control steps of this run so far.
        failures: Failed control steps in a row.
    """

    def __init__(self, itinerary: Itinerary) -> None:
        """Begin before the first run.

        Args:
            itinerary: The goals, which are told with every decision.
        """
        self._itinerary = itinerary
        self.run = self.revision = -1
        self.step = self.failures = 0

    def begin(self) -> None:
        """Begin another run."""
        self.run += 1
        self.step = self.failures = 0

    def following(
        self,
        stamp: int,
        rung: Rung,
        reason: str,
        plan: Plan,
        verdict: Verdict,
        robot: DifferentialDrive,
        **rest: Any,
    ) -> Decision:
        """To follow a plan.

        Args:
            stamp: Time stamp of the odometry that it answers [ns].
            rung: Rung of the ladder.
            reason: Why that one.
            plan: The plan.
            verdict: Of the audit.
            robot: Kinematics by which wheel speeds are commanded.
            rest: Whatever else a `Decision` has.
        """
        values = {
            'time_left': self.time_left(int(plan.horizon.edges[0])),
            **self.misses(plan.poses[-1]),
            **rest,
        }
        return Decision(
            stamp=stamp,
            rung=rung,
            reason=reason,
            wheel_speeds=plan.controls[0],
            twist=robot.twist(plan.controls[0]),
            plan=plan,
            margin=verdict.margin,
            worst_margin=verdict.worst_margin,
            **self._told(),
            **values,
        )

    def standing(
        self, stamp: int, elapsed: int, pose: Array, reason: str, margin: float, **rest: Any
    ) -> Decision:
        """To stand still.

        Args:
            stamp: Time stamp of the odometry that it answers, or of now [ns].
            elapsed: Time since the run began [ns].
            pose: Where the robot is; not numbers where nobody knows.
            reason: Why.
            margin: Clearance there [m].
            rest: Whatever else a `Decision` has.
        """
        return Decision(
            stamp=stamp,
            rung=Rung.STOP,
            reason=reason,
            wheel_speeds=np.zeros(2),
            twist=np.zeros(2),
            plan=None,
            margin=margin,
            worst_margin=margin,
            time_left=self.time_left(elapsed),
            **self._told(),
            **self.misses(pose),
            **rest,
        )

    def misses(self, pose: Array) -> dict[str, Any]:
        """How far a pose is from the goal, and its heading from the goal's."""
        settings = self._itinerary.settings
        return {'miss': settings.miss(pose), 'heading_miss': settings.heading_miss(pose)}

    def time_left(self, elapsed: int) -> float:
        """Time to the last goal [s], so long [ns] after the run began."""
        end = self._itinerary.end
        return max(0, end - elapsed) / NANOSECONDS if end < NEVER else math.inf

    def _told(self) -> dict[str, Any]:
        return {
            'step': self.step,
            'failures': self.failures,
            'run': self.run,
            'revision': self.revision,
            'goal': self._itinerary.goal,
            'told': self._itinerary.heard,
        }
