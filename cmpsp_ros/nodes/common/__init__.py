"""Shared by the nodes: lifecycle, topics, parameters and health."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.nodes.common.runtime import StartupError, run
    from cmpsp_ros.nodes.common.topics import SIM_ODOM, SIM_STAMPED_COMMAND

__getattr__, __all__ = lazy_exports(__name__, __file__)
