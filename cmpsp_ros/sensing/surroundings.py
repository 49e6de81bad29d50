"""What all sensors together have shown, at the times at which odometry comes."""

from __future__ import annotations

from dataclasses import dataclass

from cmpsp_ros.arrays import Array
from cmpsp_ros.robots import DISC, Footprint, placed
from cmpsp_ros.sensing.beams import Sight, SightSettings, project
from cmpsp_ros.sensing.local_grid import LocalGrid
from cmpsp_ros.sensing.pose_history import PoseHistory
from cmpsp_ros.world.grids import OccupancyGrid

_NS = 1_000_000_000
_SPAN = 10 * _NS
_MOST_PENDING = 100


@dataclass(frozen=True, eq=False)
class Sighting:
    """What is known around the robot.

    Attributes:
        stamp: Time stamp of the odometry at which it was known first [ns].
        grid: The cells.
    """

    stamp: int
    grid: OccupancyGrid


class Surroundings:
    """Puts together what sensors show, each by the odometry of its own time.

    In what order messages come makes no difference, as long as they come before the odometry that
    is decided on.
    """

    def __init__(
        self, settings: SightSettings, robot_radius: float, footprint: Footprint = DISC
    ) -> None:
        """Know nothing.

        Args:
            settings: All of them.
            robot_radius: Radius of the discs that cover the robot's footprint [m].
            footprint: Where those are, and what they cover.
        """
        self._settings = settings
        self._robot_radius, self._footprint = robot_radius, footprint
        self.forget()

    def forget(self) -> None:
        """Know nothing again."""
        settings = self._settings
        self._grid = LocalGrid(settings.size, settings.resolution, settings.memory)
        self._poses = PoseHistory(_SPAN)
        self._pending: list[Sight] = []
        self._seen: dict[str, int] = {}
        self._sighting: Sighting | None = None
        self._has_news = False

    def hear(self, sight: Sight) -> None:
        """Take in what a sensor shows; too much of what odometry never follows is dropped."""
        self._pending.append(sight)
        del self._pending[:-_MOST_PENDING]

    def note(self, stamp: int, pose: Array) -> None:
        """Know where the robot is, and by that what sensors have shown until then.

        Args:
            stamp: When [ns].
            pose: Shape ``(3,)`` [m, m, rad].
        """
        self._poses.add(stamp, pose)
        come = [each for each in self._pending if each.stamp <= stamp]
        self._pending = [each for each in self._pending if each.stamp > stamp]
        self._grid.center_on(float(pose[0]), float(pose[1]))
        for each in sorted(come, key=lambda each: (each.stamp, each.sensor.name)):
            if self._is_usable(each):
                self._grid.see(project(each, self._poses.at(each.stamps)))
                self._seen[each.sensor.name] = each.stamp
                self._has_news = True

    def at(self, stamp: int, pose: Array) -> Sighting | None:
        """What is known; the same as before where no sensor has shown more.

        Args:
            stamp: Time stamp of the odometry that was noted last [ns].
            pose: Its pose, shape ``(3,)`` [m, m, rad].
        """
        if self._has_news:
            corners = self._footprint.at(pose) if self._footprint.corners else None
            for x, y in placed(self._footprint.discs, pose).tolist():
                self._grid.stand_at(x, y, self._robot_radius, stamp, corners)
            self._sighting = Sighting(stamp, self._grid.at(stamp))
            self._has_news = False
        return self._sighting

    def blindness(self, stamp: int) -> str:
        """Which sensor has shown nothing for too long at a time [ns], in a sentence; or empty."""
        timeout = self._settings.timeout
        for each in self._settings.sensors:
            seen = self._seen.get(each.name)
            if seen is None:
                return f'Waiting for the first usable message of sensor {each.name}.'
            if stamp - seen > timeout * _NS:
                age = (stamp - seen) / _NS
                return f'Sensor {each.name} has shown nothing for {age:.3f} s (sight.timeout).'
        return ''

    def _is_usable(self, sight: Sight) -> bool:
        """Whether it is known where the robot was, and nothing newer of that sensor is known."""
        first = int(sight.stamps[0]) if len(sight.stamps) else sight.stamp
        newest = self._seen.get(sight.sensor.name)
        return not self._poses.is_after(first) and (newest is None or sight.stamp > newest)
