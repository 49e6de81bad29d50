"""What moves when wheels are commanded: the seam between a plant and its mechanics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from cmpsp_ros.arrays import Array
from cmpsp_ros.robots import Robot


@dataclass(frozen=True)
class Motion:
    """Where the robot is at an instant, and how it moves from there on.

    Attributes:
        stamp_ns: The instant [ns].
        pose: Shape ``(3,)`` [m, m, rad]; the heading is not wrapped.
        wheel_speeds: At which the wheels turn, shape ``(W,)`` [rad/s].
        twist: At which the robot moves, as of a `Robot`.
    """

    stamp_ns: int
    pose: Array
    wheel_speeds: Array
    twist: Array


class Body(Protocol):
    """A robot's mechanics. Times are in integer nanoseconds and never go back."""

    def place(self, stamp_ns: int, pose: Array) -> None:
        """Put the robot at a pose, shape ``(3,)`` [m, m, rad], at rest."""

    def reconfigure(self, stamp_ns: int, /, robot: Robot, wheel_lag: float) -> None:
        """Go on as another robot, or with another lag of its wheels [s]."""

    def follow(self, stamp_ns: int, control: Array, grip: Array, /) -> None:
        """Obey from an instant on, which has been reached by `drive`.

        Args:
            stamp_ns: The instant [ns].
            control: Commanded, shape ``(r,)``.
            grip: Part of its turning by which a wheel moves the robot, right and left.
        """

    def drive(self, stamp_ns: int) -> list[Motion]:
        """Let time pass, and return the motion at each change of wheel speeds on the way."""

    def motion(self, stamp_ns: int) -> Motion:
        """Pose and speeds at the instant reached by `drive`, or right after it."""

    def odometry(self, stamp_ns: int) -> Array:
        """The pose that a perfect measurement would give, shape ``(3,)`` [m, m, rad]."""
