"""A guidance law that sees: plant, scanner and law, in the order in which the nodes have them."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np

from cmpsp_ros.guidance.law import GuidanceLaw
from cmpsp_ros.parameters.catalogue import TABLE
from cmpsp_ros.parameters.courses.obstacles import obstacles_of, shapes_of
from cmpsp_ros.parameters.presets import load_parameter_file
from cmpsp_ros.parameters.robots.scans import OWN_OBSTACLES, laser_settings
from cmpsp_ros.parameters.settings import guidance_settings, plant_settings
from cmpsp_ros.sensing.laser_scan import sight_of
from cmpsp_ros.sensing.surroundings import Surroundings
from cmpsp_ros.simulator.laser import Laser
from cmpsp_ros.simulator.plant import Plant
from cmpsp_ros.simulator.ray_casting import discs_of, edges_of
from cmpsp_ros.world.free_space import FreeSpace
from cmpsp_ros.world.map_line import _lengths
from cmpsp_ros.world.roads.open_floor import OpenFloor

MS = 1_000_000


def message_of(scan, settings, frame_id):
    """A scan of the simulator as a message."""
    seconds, nanoseconds = divmod(scan.stamp_ns, 1000 * MS)
    stamp = SimpleNamespace(sec=seconds, nanosec=nanoseconds)
    return SimpleNamespace(
        header=SimpleNamespace(frame_id=frame_id, stamp=stamp),
        ranges=scan.ranges.astype(np.float32),
        angle_min=settings.angle_min,
        angle_max=settings.angle_max,
        angle_increment=settings.angle_increment,
        time_increment=settings.time_increment,
        range_min=settings.range_min,
        range_max=settings.range_max,
    )


class Drive:
    """A run, from time 0 to an end [s]; obstacles may be there from a time on.

    Attributes:
        decisions: All of them.
        pose: The last.
        clearance: Least of the driven path from all that stands there [m].
        searches: How many searches of a grid each control step has made.
    """

    def __init__(self, preset='unknown', end=None, appears=0.0, **changes):
        given = load_parameter_file(preset)
        if f'{OWN_OBSTACLES}.names' in changes:
            given = {key: value for key, value in given.items() if OWN_OBSTACLES not in key}
        values = TABLE.resolve({**given, **changes})
        self.settings = settings = guidance_settings(values)
        self.law, self.decisions, self.searches = GuidanceLaw(settings), [], []
        plant, lidar = Plant(plant_settings(values)), laser_settings(values)
        laser, surroundings = Laser(lidar, 0), Surroundings(settings.sight, settings.robot_radius)
        laser.note(plant.motion)
        (sensor,) = settings.sight.sensors
        shapes = obstacles_of(values) + shapes_of(values, OWN_OBSTACLES)
        self.clearance = math.inf
        space = FreeSpace.of(OpenFloor(), shapes, settings.robot_radius)
        there, none = (edges_of(shapes), discs_of(shapes)), (edges_of(()), discs_of(()))
        before = plant.motion
        last = round(1000 * (settings.final_time if end is None else end))
        for stamp in range(0, last * MS + 1, 20 * MS):
            is_there = stamp >= 1e9 * appears
            path = [before, *plant.advance(stamp), plant.motion]
            before = path[-1]
            laser.note(*path[1:])
            if is_there:
                poses, twists = (np.array([getattr(m, k) for m in path]) for k in ('pose', 'twist'))
                durations = np.diff([each.stamp_ns for each in path]) / 1e9
                swept = space.along(poses[:-1], twists[:-1], durations)[:, 2:]
                self.clearance = min(self.clearance, swept.min(initial=math.inf))
            while laser.is_due(stamp):
                scan = laser.scan(*(there if is_there else none))
                surroundings.hear(sight_of(message_of(scan, lidar, sensor.frame_id), sensor))
            pose = plant.measure()
            surroundings.note(stamp, pose)
            assert surroundings.blindness(stamp) == ''
            if self.law.is_due(stamp):
                sighting = surroundings.at(stamp, pose)
                known = _lengths.cache_info().misses
                decision = self.law.update(stamp, pose, (), sighting)
                self.searches.append(_lengths.cache_info().misses - known)
                plant.command(stamp, *decision.twist)
                self.law.search(pose)
                self.decisions.append(decision)
        self.pose = plant.pose
