"""Identification of a robot from a recorded drive: figures with intervals, a file, a picture."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.bags.audit.sources import Sources
from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.identify.drives import read_drives
from cmpsp_ros.bags.identify.estimates import Identification, identification
from cmpsp_ros.bags.identify.output import draw, write_parameters
from cmpsp_ros.parameters.files import load_robot
from cmpsp_ros.robots.motion import arc_ends


def identify(
    paths: Sequence[Path], sources: Sources | None = None, robot: str | None = None
) -> Identification:
    """Identify one robot, by name or file for prior values, from bags of drives of any program."""
    known: dict[str, Any] = {} if robot is None else load_robot(robot)
    drives = []
    for path in paths:
        found, parameters = read_drives(path, sources or Sources())
        drives += found
        known = {**parameters, **known}
    return identification(drives, known)


RADIUS: Final = 1.0  # radius of the circle around the start that is never left [m]
_PLANNED: Final = 0.7  # part of the circle that the commands keep to without delay or lag

# Duration [s], and speed and turn rate as parts of their limits. No two are alike, so that no delay
# looks like another. Only one axis changes at a time: the limits of wheels hold for both together.
_PHASES: Final = np.array(
    [
        (0.50, 0.0, 0.0),
        (0.95, 1.0, 0.0), (0.60, 0.0, 0.0), (0.80, -1.0, 0.0), (0.35, 0.5, 0.0),
        (0.55, -0.5, 0.0), (0.30, 1.0, 0.0), (0.45, -1.0, 0.0), (0.70, 0.5, 0.0),
        (0.40, -0.5, 0.0), (0.65, 0.0, 0.0),
        (0.85, 0.0, 1.0), (0.50, 0.0, 0.0), (0.75, 0.0, -1.0), (0.40, 0.0, 0.5),
        (0.60, 0.0, -0.5), (0.30, 0.0, 1.0), (0.45, 0.0, -1.0), (0.65, 0.0, 0.5),
        (0.70, 0.0, 0.0),
        (0.60, 0.5, 0.0), (0.55, 0.5, 0.6), (0.50, 0.5, -0.4), (0.45, 0.0, -0.4), (0.60, 0.0, 0.5),
        (0.65, -0.5, 0.5), (0.55, -0.5, -0.5), (0.45, -0.5, 0.0), (0.40, 0.0, 0.0),
        (0.50, 0.7, 0.0), (0.35, 0.7, -0.5), (0.55, 0.0, -0.5), (0.40, 0.0, 0.4), (0.50, -0.7, 0.4),
        (0.35, -0.7, 0.0), (1.15, 0.0, 0.0),
    ]
)  # fmt: skip


def excitation(max_speed: float, max_turn: float) -> tuple[Array, Array]:
    """Ends of the phases of a drive, ``(P,)`` [s], and their twists, ``(P, 2)`` [m/s, rad/s].

    Raises BagError if limits [m/s, rad/s] would lead too near to the circle.
    """
    twists = _PHASES[:, 1:] * (max_speed, max_turn)
    pose, farthest = np.zeros((1, 3)), 0.0
    for twist, duration in zip(twists, _PHASES[:, 0], strict=True):
        path = arc_ends(
            np.repeat(pose, 9, axis=0), np.tile(twist, (9, 1)), np.linspace(0.0, duration, 9)
        )
        pose, farthest = path[-1:], max(farthest, float(np.hypot(*path[:, :2].T).max()))
    if farthest > _PLANNED * RADIUS:
        raise BagError(
            f'--max-speed, --max-turn: found a way of {farthest:.2f} m from the start at'
            f' {max_speed:g} m/s and {max_turn:g} rad/s, wanted {_PLANNED * RADIUS:g} m or less'
        )
    return np.cumsum(_PHASES[:, 0]), twists
