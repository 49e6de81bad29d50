"""Files of parameters, roads and maps."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.parameters.files.presets import (
        load_robot,
        parse_assignment,
        preset_names,
        robot_names,
        robots_in,
        with_files,
        write_fleet_file,
        write_parameter_file,
    )
    from cmpsp_ros.parameters.files.ros_yaml import dump

__getattr__, __all__ = lazy_exports(__name__, __file__)
