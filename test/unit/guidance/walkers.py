"""People who walk as they like within limits, and a robot among them that is told of them."""

import math
from dataclasses import dataclass, field

import numpy as np

from cmpsp_ros.guidance import GuidanceLaw, Observation
from cmpsp_ros.guidance.messages import Track
from cmpsp_ros.robots import placed
from cmpsp_ros.simulator import Plant, PlantSettings

TICK = 10_000_000
PERIOD = 200_000_000
CREEPS = 0.05
"""Speed up to which a robot may be touched [m/s]."""


@dataclass
class Walker:
    """A disc that is accelerated as a function of time says, and never above its largest speed."""

    x: float
    y: float
    vx: float
    vy: float
    radius: float = 0.3
    push: object = None
    top: float = 1.6

    def advance(self, time, seconds):
        ax, ay = (0.0, 0.0) if self.push is None else self.push(time)
        vx, vy = self.vx + ax * seconds, self.vy + ay * seconds
        speed = math.hypot(vx, vy)
        if speed > self.top:
            vx, vy = vx * self.top / speed, vy * self.top / speed
        self.x += 0.5 * (self.vx + vx) * seconds
        self.y += 0.5 * (self.vy + vy) * seconds
        self.vx, self.vy = vx, vy

    def track(self, number, stamp):
        return Track(number, stamp, self.radius, self.x, self.y, self.vx, self.vy)


@dataclass
class Drive:
    """Outcome of a run: decisions, path, contacts at some speed, and those at rest."""

    decisions: list = field(default_factory=list)
    path: list = field(default_factory=list)
    active: list = field(default_factory=list)
    passive: int = 0


def drive(given, start, walkers, seconds, delay=0.0, lag=0.0):
    """A closed loop, with the simulator's plant and people looked at a hundred times a second."""
    plant = Plant(
        PlantSettings(
            robot=given.robot,
            initial_pose=start,
            actuation_delay=delay,
            wheel_lag=lag,
            cmd_vel_timeout=0.0,
        )
    )
    law, run = GuidanceLaw(given, given.world), Drive()
    for stamp in range(0, round(seconds * 1e9), TICK):
        plant.advance(stamp)
        motion = plant.motion
        if stamp % PERIOD == 0:
            tracks = tuple(each.track(number, stamp) for number, each in enumerate(walkers))
            decision = law.step(Observation(stamp, motion.pose, tracks))
            law.after_step()
            run.decisions.append(decision)
            run.path.append(motion.pose.tolist())
            plant.command(stamp, *decision.twist.tolist())
            plant.advance(stamp)
            motion = plant.motion
            if decision.finished:
                break
        speed = float(np.abs(given.footprint.speeds_and_turns(motion.twist[None])[:, 0]).max())
        places = placed(given.footprint.discs, motion.pose)
        for each in walkers:
            away = np.hypot(*(places - np.array([each.x, each.y])).T).min()
            depth = each.radius + given.robot_radius - away
            if depth > 1e-6 and speed > CREEPS:
                run.active.append((stamp / 1e9, speed, depth))
            elif depth > 1e-6:
                run.passive += 1
            each.advance(stamp / 1e9, TICK / 1e9)
    return run
