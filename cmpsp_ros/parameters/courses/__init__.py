"""Courses from parameters: road, map, obstacles and goals, and their checks."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.parameters.courses.course import course_problems
    from cmpsp_ros.parameters.courses.files import with_files
    from cmpsp_ros.parameters.courses.maps import text_of
    from cmpsp_ros.parameters.courses.obstacles import obstacles_of, shapes_of
    from cmpsp_ros.parameters.courses.road_messages import road_in
    from cmpsp_ros.parameters.courses.roads import lacks_road, road_keys, road_of

__getattr__, __all__ = lazy_exports(__name__, __file__)
