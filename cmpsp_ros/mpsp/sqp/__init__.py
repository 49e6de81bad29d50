"""The C-MPSP iteration: one state machine for problems in Python and in compiled code."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.mpsp.sqp.cmpsp import CMPSP
    from cmpsp_ros.mpsp.sqp.driver import Driver, Entries, Functions, Results

__getattr__, __all__ = lazy_exports(__name__, __file__)
