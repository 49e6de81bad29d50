"""The active-set method on stage-wise programs."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.mpsp.qp.active_set.records import derivatives_in
    from cmpsp_ros.mpsp.qp.active_set.solver import correct, solve
    from cmpsp_ros.mpsp.qp.active_set.state import empty_active_set, empty_warm_start

__getattr__, __all__ = lazy_exports(__name__, __file__)
