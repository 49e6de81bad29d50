"""Parameters: one table of them, and the settings built from it."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.parameters.catalogue import TABLE
    from cmpsp_ros.parameters.course import course_problems
    from cmpsp_ros.parameters.errors import ParameterError, Problem, describe
    from cmpsp_ros.parameters.files.presets import config_directory, load_parameter_file
    from cmpsp_ros.parameters.obstacles import shapes_of, text_of
    from cmpsp_ros.parameters.parameter import Parameter
    from cmpsp_ros.parameters.plausibility import plausibility_warnings
    from cmpsp_ros.parameters.roads import lacks_road, road_keys
    from cmpsp_ros.parameters.robots import footprint_of
    from cmpsp_ros.parameters.settings import (
        check_simulation,
        guidance_settings,
        laser_settings,
        people_settings,
        plant_settings,
        scenery,
    )
    from cmpsp_ros.parameters.table import Values, is_of_ros

__getattr__, __all__ = lazy_exports(__name__, __file__)
