"""Courses that are partly in separate files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cmpsp_ros.parameters.courses.map_files import with_map_file
from cmpsp_ros.parameters.courses.road_files import with_road_file


def with_files(values: Mapping[str, Any], folder: Path | None = None) -> dict[str, Any]:
    """The values with the road and the map of the files that they name.

    Args:
        values: Values by key.
        folder: See `with_map_file`.

    Raises:
        ParameterError: A file cannot be read, or is not what it should be.
    """
    return with_map_file(with_road_file(values), folder)
