"""One run, from parameters to pictures: the nodes as processes, monitored, recorded, summarised.

A run that cannot be started, or does not end, is a `DemoError`.
"""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.demo.processes import Child, DemoError, make_folder, use_free_domain
    from cmpsp_ros.demo.runner import guide, run, started
    from cmpsp_ros.demo.scenario import Scenario, load_fleet, load_scenario
    from cmpsp_ros.demo.summary import Summary

__getattr__, __all__ = lazy_exports(__name__, __file__)
