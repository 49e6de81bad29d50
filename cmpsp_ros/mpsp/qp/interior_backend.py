"""The Riccati interior point as a back end, for programs with many active rows."""

from __future__ import annotations

from cmpsp_ros.mpsp.qp.rooms import Rooms
from cmpsp_ros.mpsp.qp.solution import (
    Penalties,
    QPSolution,
    QPStatus,
    largest_multipliers,
)
from cmpsp_ros.mpsp.qp.stage_answer import named, solved
from cmpsp_ros.mpsp.riccati import interior_point
from cmpsp_ros.mpsp.riccati.interior_room import CONFLICT, STEPS, interior_room
from cmpsp_ros.mpsp.riccati.outcome import INFEASIBLE, SOLVED
from cmpsp_ros.mpsp.subproblem import Subproblem

_rooms = Rooms(interior_room)


def solve(subproblem: Subproblem, penalties: Penalties | None) -> QPSolution:
    """Solve a subproblem by the primal-dual interior point."""
    qp, size = subproblem.stages, subproblem.size
    with _rooms.of(size) as room:
        outcome = interior_point.solve(qp, largest_multipliers(size, penalties), room)
        if outcome == SOLVED:
            return solved(room.dU, room.multipliers, int(room.counts[STEPS]))
        if outcome == INFEASIBLE:
            conflict = named(qp, room.conflict[: room.counts[CONFLICT]].tolist())
            return QPSolution.unsolved(size, QPStatus.INFEASIBLE, conflict)
        return QPSolution.unsolved(size, QPStatus.FAILED)
