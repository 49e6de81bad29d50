"""Courses that are partly in separate files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cmpsp_ros.parameters.courses.map_files import with_map_file
from cmpsp_ros.parameters.courses.road_files import with_road_file


def with_files(values: Mapping[str, Any], folder: Path | None = None) -> dict[str, Any]:
    """Replace the names of road and map files by their contents.

    Args:
        values: Values by key.
        folder: See `with_map_file`.

    Raises:
        ParameterError: A file cannot be read, or is invalid.
    """
    return with_map_file(with_road_file(values), folder)
