"""Experiments on the guidance law without ROS."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.studies.common import WIDTH, cpu_model, plot_style

__getattr__, __all__ = lazy_exports(__name__, __file__)
