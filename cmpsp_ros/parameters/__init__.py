"""What the user may set: one table of parameters, and what is built from it."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.parameters.catalogue import TABLE
    from cmpsp_ros.parameters.documentation import with_section
    from cmpsp_ros.parameters.errors import ParameterError, Problem, describe
    from cmpsp_ros.parameters.parameter import Node, Parameter, ParameterType
    from cmpsp_ros.parameters.plausibility import plausibility_warnings
    from cmpsp_ros.parameters.presets import (
        config_directory,
        load_parameter_file,
        load_robot,
        parse_assignment,
        preset_names,
        robot_names,
        robots_in,
        write_fleet_file,
        write_parameter_file,
    )
    from cmpsp_ros.parameters.ros_yaml import dump
    from cmpsp_ros.parameters.settings import (
        check_pace,
        check_start,
        guidance_settings,
        plant_settings,
    )
    from cmpsp_ros.parameters.table import ParameterTable, Values, is_of_ros

__getattr__, __all__ = lazy_exports(__name__, __file__)
