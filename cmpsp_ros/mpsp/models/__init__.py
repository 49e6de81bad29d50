"""Problems from functions and CasADi expressions, wrappers, and a check of derivatives."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.mpsp.models.control_rate import (
        CONTROL_RATE,
        ControlRateData,
        ControlRateProblem,
        Rates,
        rate_rows,
    )
    from cmpsp_ros.mpsp.models.free_time import FREE_TIME, FreeTimeData

__getattr__, __all__ = lazy_exports(__name__, __file__)
