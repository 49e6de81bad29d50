"""Obstacles that move, as the simulator tells of them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from cmpsp_ros.guidance.messages import Track

if TYPE_CHECKING:
    from cmpsp_ros.parameters import Values

_NS: Final = 1_000_000_000


class Traffic:
    """Obstacles on straight ways, from the robot's first command on."""

    def __init__(self, values: Values) -> None:
        """Stand still.

        Args:
            values: Parameters of the simulator.
        """
        names = values['moving_obstacles.names']
        self._blocks: list[Any] = [
            [values[f'moving_obstacles.{name}.{key}'] for key in ('center', 'velocity', 'radius')]
            for name in names
        ]
        self._moves_since: int | None = None

    def __len__(self) -> int:
        """How many there are."""
        return len(self._blocks)

    def begin(self, stamp_ns: int) -> None:
        """Move from now on, unless they move already."""
        if self._moves_since is None:
            self._moves_since = stamp_ns

    def reset(self) -> None:
        """Back to where they were at first, and stand."""
        self._moves_since = None

    def at(self, stamp_ns: int) -> list[Track]:
        """Where they are at an instant [ns]."""
        moves, since = self._moves_since is not None, self._moves_since or 0
        seconds = (stamp_ns - since) / _NS if moves else 0.0
        tracks = []
        for number, ((x, y), (vx, vy), radius) in enumerate(self._blocks):
            u, v = (vx, vy) if moves else (0.0, 0.0)
            x_now, y_now = x + seconds * u, y + seconds * v
            tracks.append(Track(number, stamp_ns, radius, x_now, y_now, u, v))
        return tracks
