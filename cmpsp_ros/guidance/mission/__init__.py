"""Where to drive to, and when to be there."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.guidance.mission.feasibility_precheck import (
        infeasibility_warnings,
        shortest_time,
    )
    from cmpsp_ros.guidance.mission.start import reason_not_to_begin

__getattr__, __all__ = lazy_exports(__name__, __file__)
