"""Solvers of whole programs: dense ones of the condensed program, Clarabel, the closed form."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.mpsp.qp.dense.back_ends import solve_by_daqp
    from cmpsp_ros.mpsp.qp.dense.clarabel_backend import cone_program, run
    from cmpsp_ros.mpsp.qp.dense.condensing import CondensedQP, condense
    from cmpsp_ros.mpsp.qp.dense.rows import SparseQP, sparse_qp

__getattr__, __all__ = lazy_exports(__name__, __file__)
