"""Experiments on the guidance law without ROS."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.studies.plot_style import WIDTH, journal
    from cmpsp_ros.studies.processor import cpu_model

__getattr__, __all__ = lazy_exports(__name__, __file__)
