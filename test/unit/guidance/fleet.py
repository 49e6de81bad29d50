"""Several laws in a closed loop, each told of the plans that the others publish."""

from dataclasses import replace

import numpy as np
from scenarios import PERIOD

from cmpsp_ros.guidance import GuidanceLaw, MovingObstacles, Observation
from cmpsp_ros.guidance.messages import PeerTrajectory, Tracks

GRID = 20_000_000
PARTS = 10


class Robot:
    """A robot that drives exactly, with its law."""

    def __init__(self, name, given, start, offset=0):
        self.name, self.given, self.law = name, given, GuidanceLaw(given, given.world)
        self.pose, self.offset = np.array(start), offset
        self.known, self.decisions = Tracks(), []

    def decide(self, stamp):
        """Decide on odometry; the plan that the others hear of."""
        timeout = self.given.moving_obstacles.timeout
        seen = self.known.at(stamp, timeout)
        decision = self.law.step(Observation(stamp, self.pose, seen))
        self.decisions.append(decision)
        if decision.plan is None:
            return PeerTrajectory(self.name, stamp, (stamp,), (tuple(self.pose[:2].tolist()),))
        places = tuple((x, y) for x, y, _ in decision.plan.poses.tolist())
        return PeerTrajectory(self.name, stamp, tuple(decision.plan.stamps(stamp)), places)


def among(given, names, radius, **rest):
    """Settings of a robot that keeps clear of others."""
    known = MovingObstacles(others=tuple(names), others_radius=radius, **rest)
    return replace(given, moving_obstacles=known, robot_radius=radius)


def drive(robots, seconds, late=0):
    """Drive all of them; the least clearance between any two, and their paths.

    Args:
        robots: Of the fleet; each begins its run at its offset [ns].
        seconds: How long [s].
        late: Time that a plan takes to the others [ns].
    """
    least, on_the_way, paths = np.inf, [], {each.name: [] for each in robots}
    for tick in range(round(seconds * 1e9) // GRID):
        stamp = tick * GRID
        arrived = [each for each in on_the_way if each[0] <= stamp]
        on_the_way = [each for each in on_the_way if each[0] > stamp]
        for _, plan in arrived:
            for each in robots:
                if each.name != plan.id:
                    each.known.add([plan])
        for each in robots:
            if stamp >= each.offset and (stamp - each.offset) % PERIOD == 0:
                on_the_way.append((stamp + late, each.decide(stamp)))
        ways = []
        for each in robots:
            speeds = each.decisions[-1].wheel_speeds if each.decisions else np.zeros(2)
            parts = np.full(PARTS, GRID / 1e9 / PARTS)
            way = each.given.robot.roll_out(each.pose, np.tile(speeds, (PARTS, 1)), parts)
            each.pose = way[-1]
            ways.append(way[:, :2])
            paths[each.name].append(way[-1].copy())
        for i, one in enumerate(ways):
            for j in range(i):
                away = np.linalg.norm(one - ways[j], axis=1).min()
                kept = robots[i].given.robot_radius + robots[j].given.robot_radius
                least = min(least, float(away - kept))
    return least, {name: np.array(path) for name, path in paths.items()}
