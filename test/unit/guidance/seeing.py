"""A guidance law that sees: plant, scanner and law, in the order in which the nodes have them."""

import math
from itertools import count
from types import SimpleNamespace

import numpy as np

from cmpsp_ros.guidance import GuidanceLaw, Observation
from cmpsp_ros.parameters import (
    TABLE,
    guidance_settings,
    laser_settings,
    load_parameter_file,
    plant_settings,
    shapes_of,
)
from cmpsp_ros.parameters.obstacles import obstacles_of
from cmpsp_ros.sensing import Surroundings, sight_of
from cmpsp_ros.simulator import Laser, Plant, discs_of, edges_of
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.map_line import _lengths
from cmpsp_ros.world.roads import OpenFloor

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


CAMERA_HEIGHT, SLOPES = 0.3, np.tan(np.radians(np.linspace(-60.0, 5.0, 80)))
"""Height of a depth camera above the floor [m], and slopes of its beams one above the other."""


def cloud_of(scan, settings, frame_id, sees_floor):
    """Sight of a depth camera in place of the scanner: walls higher than it, and the floor."""
    angles = settings.angle_min + (settings.angle_max - settings.angle_min) * np.linspace(
        0.0, 1.0, len(scan.ranges)
    )
    floor = np.where((SLOPES < 0.0) & sees_floor, CAMERA_HEIGHT / np.abs(SLOPES), math.inf)
    ranges = np.where(np.isfinite(scan.ranges), scan.ranges, math.inf)
    away = np.minimum(ranges, floor[:, None])
    z = SLOPES[:, None] * np.where(np.isfinite(away), away, 0.0)
    is_there = np.isfinite(away) & (z > -1.001 * CAMERA_HEIGHT)
    points = np.stack([away * np.cos(angles), away * np.sin(angles), z], axis=-1)[is_there]
    data = points.astype('<f4')
    fields = [
        SimpleNamespace(name=name, offset=4 * k, datatype=7, count=1)
        for k, name in enumerate('xyz')
    ]
    seconds, nanoseconds = divmod(scan.stamp_ns, 1000 * MS)
    stamp = SimpleNamespace(sec=seconds, nanosec=nanoseconds)
    return SimpleNamespace(
        header=SimpleNamespace(frame_id=frame_id, stamp=stamp),
        height=1,
        width=len(data),
        fields=fields,
        is_bigendian=False,
        point_step=12,
        row_step=12 * len(data),
        data=data.tobytes(),
    )


class Drive:
    """A run, from time 0 to an end [s]; obstacles may be there from a time on.

    With a sensor of type `cloud` the scanner is a depth camera, which may see the floor.

    Attributes:
        decisions: All of them.
        poses: As measured for the decisions.
        pose: The last.
        clearance: Least of the driven path from all that stands there [m].
        searches: How many searches of a grid each control step has made.
        improved: How many plans were improved in each control step.
        looked: How often the clock was looked at after it, thrice for each plan improved then.
    """

    def __init__(self, preset='unknown', end=None, appears=0.0, sees_floor=True, **changes):
        given = load_parameter_file(preset)
        if 'sim.obstacles.names' in changes:
            given = {key: value for key, value in given.items() if 'sim.obstacles' not in key}
        values = TABLE.resolve({**given, **changes})
        self.settings = settings = guidance_settings(values)
        clock = count(0, MS)
        self.law = GuidanceLaw(settings, settings.world, clock.__next__)
        self.decisions, self.poses = [], []
        self.searches, self.improved, self.looked = [], [], []
        plant, lidar = Plant(plant_settings(values)), laser_settings(values)
        laser, surroundings = Laser(lidar, 0), Surroundings(settings.sight, settings.robot_radius)
        laser.note(plant.motion)
        (sensor,) = settings.sight.sensors
        shapes = obstacles_of(values) + shapes_of(values)
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
                if sensor.type == 'cloud':
                    message = cloud_of(scan, lidar, sensor.frame_id, sees_floor)
                else:
                    message = message_of(scan, lidar, sensor.frame_id)
                surroundings.add(sight_of(message, sensor))
            pose = plant.measure()
            surroundings.update(stamp, pose)
            assert surroundings.blindness(stamp) == ''
            if self.law.is_due(stamp):
                sighting = surroundings.at(stamp, pose)
                known = _lengths.cache_info().misses
                tracks = () if sighting is None else sighting.tracks
                decision = self.law.step(Observation(stamp, pose, tracks, sighting))
                self.searches.append(_lengths.cache_info().misses - known)
                plant.command(stamp, *decision.twist)
                # The clock moves on by 1 ms whenever it is looked at: before and after a solution.
                self.improved.append(decision.phases.get('solve', 0.0))
                began = next(clock)
                self.law.after_step()
                self.looked.append((next(clock) - began) // MS - 1)
                self.decisions.append(decision)
                self.poses.append(pose)
        self.pose = plant.pose
