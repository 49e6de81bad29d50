"""Goals of the run and their times."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.guidance.mission.feasibility import (
        infeasibility_warnings,
        reason_not_to_begin,
        shortest_time,
    )

__getattr__, __all__ = lazy_exports(__name__, __file__)
