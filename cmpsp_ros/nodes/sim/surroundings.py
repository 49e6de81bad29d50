"""Surroundings of the simulated robot: moving obstacles, and scans of all shapes as messages."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import LaserScan

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance import NANOSECONDS
from cmpsp_ros.guidance.messages import Track
from cmpsp_ros.nodes.common.messages import BASE, cloud_of, rotation_of, set_stamp
from cmpsp_ros.nodes.common.topics import SIM_PEOPLE, SIM_SCAN
from cmpsp_ros.parameters import Values, footprint_of, laser_settings, people_settings, scenery
from cmpsp_ros.robots import placed
from cmpsp_ros.simulator import Laser, Motion, People, discs_of, edges_of

if TYPE_CHECKING:
    from cmpsp_ros.nodes.sim.node import SimNode

_FINE: Final = 4096.0  # parts of a metre in which people are published: bags stay small


class Traffic:
    """Obstacles on straight paths, from the robot's first command on; at rest before it."""

    def __init__(self, values: Values) -> None:
        self._blocks = [
            [values[f'moving_obstacles.{name}.{key}'] for key in ('center', 'velocity', 'radius')]
            for name in values['moving_obstacles.names']
        ]
        self._moves_since: int | None = None

    def __len__(self) -> int:
        return len(self._blocks)

    def begin(self, stamp_ns: int) -> None:
        """Move from now on, unless they move already."""
        if self._moves_since is None:
            self._moves_since = stamp_ns

    def reset(self) -> None:
        """Return to the initial places, at rest."""
        self._moves_since = None

    def at(self, stamp_ns: int) -> list[Track]:
        """The obstacles at an instant [ns]."""
        moves, since = self._moves_since is not None, self._moves_since or 0
        seconds = (stamp_ns - since) / NANOSECONDS if moves else 0.0
        tracks = []
        for number, ((x, y), (vx, vy), radius) in enumerate(self._blocks):
            u, v = (vx, vy) if moves else (0.0, 0.0)
            x_now, y_now = x + seconds * u, y + seconds * v
            tracks.append(Track(number, stamp_ns, radius, x_now, y_now, u, v))
        return tracks


class Pedestrians:
    """People on foot, and the topic on which judges find them."""

    def __init__(self, sim: SimNode) -> None:
        values, settings = sim.values, people_settings(sim.values)
        shapes, lines = scenery(values)
        self._people = People(settings, edges_of(shapes, lines), discs_of(shapes))
        self._publisher = SIM_PEOPLE.publish_on(sim) if len(self._people) else None
        self._frame_id, (self._footprint, self._radius) = values['frame_id'], footprint_of(values)
        self.begin, self.reset = self._people.begin, self._people.reset
        self.visible_at = self._people.visible_at

    def advance(self, stamp_ns: int, pose: Array) -> None:
        """Let them walk up to an instant [ns], at which the robot is at a pose ``(3,)``."""
        self._people.advance(stamp_ns, placed(self._footprint.discs, pose), self._radius)

    def publish(self, stamp_ns: int) -> None:
        """Publish where they are at an instant [ns]."""
        if self._publisher is None:
            return
        states = np.round(self._people.at(stamp_ns) * _FINE) / _FINE
        tracks = [
            Track(number, stamp_ns, radius, x, y, u, v)
            for number, (x, y, u, v, radius) in enumerate(states.tolist())
        ]
        self._publisher.publish(cloud_of(tracks, stamp_ns, self._frame_id))


class Scanner:
    """A laser among the shapes of a course, those that only the simulator knows, and traffic."""

    def __init__(self, sim: SimNode, traffic: Traffic, people: Pedestrians) -> None:
        values, motion = sim.values, sim.plant.motion
        self._settings, self._traffic, self._people = laser_settings(values), traffic, people
        self._laser = Laser(self._settings, motion.stamp_ns)
        self._frame_id = values['sim.scan.frame_id']
        self._publisher = SIM_SCAN.publish_on(sim)
        self._complete: list[LaserScan] = []
        self._published_ns = motion.stamp_ns
        self.look_around(values)
        self.note(motion)

    def look_around(self, values: Values) -> None:
        """Take over the shapes of a course."""
        shapes, lines = scenery(values)
        self._edges, self._discs = edges_of(shapes, lines), discs_of(shapes)

    def reset(self, motion: Motion) -> None:
        """Begin anew."""
        self._complete.clear()
        self._laser.reset(motion.stamp_ns)
        self.note(motion)

    def note(self, *motions: Motion) -> None:
        """Remember how the robot moves from some instants on, in order."""
        self._laser.note(*motions)

    def publish(self, stamp_ns: int) -> None:
        """Publish the scans completed by an instant [ns], at the same instant again the same."""
        if stamp_ns != self._published_ns:
            self._complete.clear()
        self._published_ns = stamp_ns
        while self._laser.is_due(stamp_ns):
            self._complete.append(self._next())
        for each in self._complete:
            self._publisher.publish(each)

    def transform(self, stamp_ns: int) -> TransformStamped:
        """Pose of the scanner on the robot."""
        x, y, heading = self._settings.pose
        message = TransformStamped(child_frame_id=self._frame_id)
        set_stamp(message.header, stamp_ns)
        message.header.frame_id = BASE
        message.transform.translation.x, message.transform.translation.y = x, y
        message.transform.rotation = rotation_of(heading)
        return message

    def _next(self) -> LaserScan:
        settings = self._settings
        moving = [
            (each.x, each.y, each.vx, each.vy, each.radius)
            for each in self._traffic.at(self._laser.next_ns)
        ]
        people = self._people.visible_at(self._laser.next_ns)
        discs = np.vstack([self._discs, np.array(moving).reshape(-1, 5), people])
        scan = self._laser.scan(self._edges, discs)
        message = LaserScan(
            angle_min=settings.angle_min,
            angle_max=settings.angle_max,
            angle_increment=settings.angle_increment,
            time_increment=settings.time_increment,
            scan_time=1.0 / settings.rate,
            range_min=settings.range_min,
            range_max=settings.range_max,
            ranges=scan.ranges.astype(np.float32),
        )
        set_stamp(message.header, scan.stamp_ns)
        message.header.frame_id = self._frame_id
        return message
