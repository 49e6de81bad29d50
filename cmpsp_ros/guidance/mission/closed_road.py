"""A road that obstacles close: the robot stops before them, and stays until something changes."""

from __future__ import annotations

import math
from dataclasses import dataclass

from cmpsp_ros.guidance.goals import Target
from cmpsp_ros.guidance.horizon import NANOSECONDS
from cmpsp_ros.guidance.mission.closures import closures
from cmpsp_ros.guidance.prediction.plan_start import PlanStart
from cmpsp_ros.guidance.safety.approach import STANDSTILL, Approach, Contact
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.world.roads import Point, arc_length_to

_SHORTEST = 0.5
"""Part of the arc length along the centre line that a way through bends has at least."""

_SOON = 3 * NANOSECONDS
"""How long the robot may take to come nearer [ns]."""


@dataclass
class ClosedRoad:
    """What closes the road to the present goal, as far as it has been looked at.

    Attributes:
        obstacles: Names of the obstacles between which nothing gets through.
        goal: The goal to which it has been looked at (x, y) [m]; None for not at all.
        waits: Why the robot waits before them, in a sentence; empty where it does not.
        nearest: How near it has come to them [m].
        nearest_at: When that was [ns].
    """

    obstacles: frozenset[str] = frozenset()
    goal: Point | None = None
    waits: str = ''
    nearest: float = math.inf
    nearest_at: int = 0

    def look(self, settings: LawSettings, start: PlanStart, target: Target) -> None:
        """Look whether the road is closed for the robot without its margin; once for each goal.

        Args:
            settings: All settings of the guidance law.
            start: Where plans begin.
            target: What they are to meet.
        """
        if self.obstacles or self.goal == target.position:
            return
        self.goal = target.position
        here, wanted = (float(start.pose[0]), float(start.pose[1])), 2.0 * settings.robot_radius
        found = closures(start.world.road, start.world.shapes, here, self.goal, wanted)
        self.obstacles = frozenset(name for names, _ in found for name in names)

    def ahead(
        self, settings: LawSettings, approach: Approach, start: PlanStart, now: int
    ) -> Contact | None:
        """The nearest of what closes the road, where that is known.

        Args:
            settings: All settings of the guidance law.
            approach: Knows how fast the robot may be before it.
            start: Where plans begin.
            now: Present time [ns].
        """
        if self.goal is None or not self.obstacles:
            return None
        road, pose, progress = start.world.road, start.pose, start.progress
        sense = math.copysign(1.0, arc_length_to(road, pose, self.goal, progress=progress))
        away = {}
        for shape in start.world.shapes:
            if shape.name in self.obstacles:
                along = [
                    arc_length_to(road, pose, each, progress=progress) for each in shape.corners
                ]
                least = _SHORTEST * min(sense * each for each in along)
                away[shape.name] = least - shape.radius - settings.circumscribed_radius
        contact = approach.before(away, start)
        if contact.distance < self.nearest:
            self.nearest, self.nearest_at = contact.distance, now
        return contact

    def reason_to_wait(self, contact: Contact, now: int) -> str:
        """Why the robot waits from now on, in a sentence; empty where it does not.

        A plan that does not get it any nearer to what closes the road only spends its time.

        Args:
            contact: The nearest of what closes the road.
            now: Present time [ns].
        """
        if contact.speed < STANDSTILL or now - self.nearest_at > _SOON:
            return self.wait_before(contact)
        return ''

    def wait_before(self, contact: Contact) -> str:
        """Wait from now on; why, in a sentence."""
        self.waits = f'The road is closed at {contact.name}: the robot waits before it.'
        return self.waits
