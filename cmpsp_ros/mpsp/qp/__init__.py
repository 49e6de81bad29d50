"""Quadratic programs of one iteration, and the back ends that solve them."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.mpsp.qp.active_set.records import kkt_residual
    from cmpsp_ros.mpsp.qp.back_ends import (
        CLARABEL,
        RICCATI_ACTIVE_SET,
        available,
        backend,
        no_warm_start,
        solve,
        solve_from,
        solve_qp,
    )
    from cmpsp_ros.mpsp.qp.subproblem import Penalties, QPSolution, QPStatus, Row, Subproblem

__getattr__, __all__ = lazy_exports(__name__, __file__)
