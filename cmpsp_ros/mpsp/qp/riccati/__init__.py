"""The stage-wise quadratic program: its records, Riccati sweeps, and the check of an answer."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.mpsp.qp.riccati.program import Outcome, empty_program, row_type, stage_type

__getattr__, __all__ = lazy_exports(__name__, __file__)
