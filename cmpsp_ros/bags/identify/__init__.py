"""Identification of a robot from a recorded drive: figures with intervals, a file, a picture."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from cmpsp_ros.bags.audit.sources import Sources
from cmpsp_ros.bags.identify.drives import read_drives
from cmpsp_ros.bags.identify.estimates import Identification, identification
from cmpsp_ros.bags.identify.excitation import RADIUS, excitation
from cmpsp_ros.bags.identify.output import draw, write_parameters
from cmpsp_ros.parameters.files import load_robot


def identify(
    paths: Sequence[Path], sources: Sources | None = None, robot: str | None = None
) -> Identification:
    """Identify one robot from its drives.

    Args:
        paths: Bags of odometry and commands, of any program.
        sources: Topics, where they cannot be found.
        robot: Name or file of the robot, with its prior values.

    Raises:
        BagError: A bag cannot be used.
        ParameterError: The robot's file cannot be used.
    """
    known: dict[str, Any] = {} if robot is None else load_robot(robot)
    drives = []
    for path in paths:
        found, parameters = read_drives(path, sources or Sources())
        drives += found
        known = {**parameters, **known}
    return identification(drives, known)
