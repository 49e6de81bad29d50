"""Monte Carlo studies: many random courses, driven by the guidance law and the plant alone."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.studies.common import StudyError, UsageError
    from cmpsp_ros.studies.monte_carlo.eyes import Eyes
    from cmpsp_ros.studies.monte_carlo.kinds import KINDS
    from cmpsp_ros.studies.monte_carlo.run import Order, run_one, run_study
    from cmpsp_ros.studies.monte_carlo.study import MOST_OBSTACLES, Study
    from cmpsp_ros.studies.monte_carlo.summary import tables

__getattr__, __all__ = lazy_exports(__name__, __file__)
