"""Search of poses for the moves of a robot that has no space to turn: hybrid A*, from the goal.

It is tight there, and few poses are clear. Dolgov et al., Path planning for autonomous vehicles in
unknown semi-structured environments, 2010. Lengths are in turning radii, costs in 1/400 of one.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.robots.motion import point_of
from cmpsp_ros.world import SpaceData
from cmpsp_ros.world.obstacles import distance_from
from cmpsp_ros.world.roads import road_functions

_CELL: Final = 1.0 / 1.5  # size of the cells with one pose a heading and direction, in strokes
_UNIT: Final = 400.0
_CUSP: Final = 400  # cost of a change of direction
_BEND: Final = 20  # cost of a change of the steering alone
_CHECKS: Final = 2  # poses of a move that are checked, with its end
_NODES: Final = 1 << 17
_BUCKETS: Final = 1 << 16
_NONE: Final = -1
_MOVES: Final = 6
_MIXER: Final = 0x9E3779B1
"""Odd, and far from simple fractions of a power of two: neighbours spread over the table."""


class Surroundings(NamedTuple):
    """Space to keep to, and moves, for compiled code."""

    space: SpaceData
    depth: float  # allowed depth in what is kept from things: that of start or goal [m]
    radius: float  # turning radius; of a robot that turns on the spot, a length [m]
    turns_on_the_spot: bool  # whether it does
    stroke: float  # length of a move, and the turn of one that is no straight line [rad]


class Tree(NamedTuple):
    """Poses found so far, and what is kept of each."""

    poses: Array  # shape ``(K, 3)`` [m, m, rad]
    numbers: IntArray  # cost, node before, move that led here, and next in the bucket, ``(K, 4)``
    cells: IntArray  # cell of each node ``(K, 4)``: two of the position, heading, direction
    table: IntArray  # node of each cell by its hash, `_NONE` for none
    buckets: IntArray  # first node by the least cost of a path through it
    counts: IntArray  # number of nodes, the bucket that is worked on, and the expansions so far

    @classmethod
    def at(cls, goal: Array) -> Tree:
        """A tree with its root alone."""
        tree = cls(
            np.empty((_NODES, 3)),
            np.empty((_NODES, 4), dtype=np.int64),
            np.empty((_NODES, 4), dtype=np.int64),
            np.full(2 * _NODES, _NONE, dtype=np.int64),
            np.full(_BUCKETS, _NONE, dtype=np.int64),
            np.array([1, 0, 0], dtype=np.int64),
        )
        tree.poses[0], tree.numbers[0], tree.cells[0] = goal, (0, _NONE, _NONE, _NONE), 0
        tree.buckets[0] = 0
        return tree

    def moves_to(self, node: int) -> list[int]:
        """Moves from the root to a node."""
        moves: list[int] = []
        while (move := self.numbers[node, 2].item()) != _NONE:
            moves.append(move)
            node = self.numbers[node, 1].item()
        return moves[::-1]


@allocation_free
def expand(tree: Tree, around: Surroundings, start: Array, count: int) -> int:
    """Expand so many of the cheapest nodes; the last one, or -1 where none is left."""
    node = -1
    for _ in range(count):
        node = _take(tree)
        if node < 0 or tree.counts[0] + _MOVES > tree.poses.shape[0]:
            return -1
        tree.counts[2] += 1
        for move in range(_MOVES):
            _try(tree, around, start, node, move)
    return node


@allocation_free
def is_clear(around: Surroundings, pose: Array, segments: Array) -> bool:
    """True if a path of turns and lengths ``(K, 2)`` is clear; the pose is left at its end."""
    for k in range(segments.shape[0]):
        turn, length = int(segments[k, 0]), segments[k, 1]
        pieces = math.ceil(_CHECKS * abs(length) / around.stroke)
        for _ in range(pieces):
            pose[0], pose[1], pose[2] = _after(around, pose, turn, length / pieces)
            if not _is_clear(around, pose[0], pose[1], pose[2]):
                return False
    return True


@allocation_free
def _take(tree: Tree) -> int:
    """The cheapest node that is not superseded."""
    while tree.counts[1] < tree.buckets.shape[0]:
        node: int = tree.buckets[tree.counts[1]]
        if node < 0:
            tree.counts[1] += 1
            continue
        tree.buckets[tree.counts[1]] = tree.numbers[node, 3]
        slot = _slot_of(tree, tree.cells[node])
        if node == 0 or tree.table[slot] == node:
            return node
    return -1


@allocation_free
def _try(tree: Tree, around: Surroundings, start: Array, node: int, move: int) -> None:
    """Add the node that a move leads to, if it is clear and cheaper than one in its cell."""
    turn, gear = move // 2 - 1, 1 - 2 * (move % 2)
    before = tree.numbers[node, 2]
    cost = tree.numbers[node, 0] + int(_UNIT * around.stroke)
    if before >= 0:
        is_bend, is_cusp = before // 2 != move // 2, before % 2 != move % 2
        if is_cusp and not (is_bend and around.turns_on_the_spot):
            cost += _CUSP
        elif is_bend:
            cost += _BEND
    stroke, cell_size = gear * around.stroke, _CELL * around.stroke * around.radius
    x, y, heading = _after(around, tree.poses[node], turn, stroke)
    new = tree.counts[0]
    cell = tree.cells[new]
    cell[0] = math.floor((x - tree.poses[0, 0]) / cell_size)
    cell[1] = math.floor((y - tree.poses[0, 1]) / cell_size)
    cell[2], cell[3] = tree.cells[node, 2] + turn * gear, gear
    slot = _slot_of(tree, cell)
    known = tree.table[slot]
    if known >= 0 and tree.numbers[known, 0] <= cost:
        return
    for i in range(1, _CHECKS + 1):
        part = stroke * i / _CHECKS
        at_x, at_y, at_heading = _after(around, tree.poses[node], turn, part)
        if not _is_clear(around, at_x, at_y, at_heading):
            return
    tree.poses[new, 0], tree.poses[new, 1], tree.poses[new, 2] = x, y, heading
    tree.numbers[new, 0], tree.numbers[new, 1], tree.numbers[new, 2] = cost, node, move
    away = math.hypot(start[0] - x, start[1] - y) / around.radius
    left = int(_UNIT * max(away, abs(start[2] - heading)))
    bucket = max(min(cost + left, tree.buckets.shape[0] - 1), tree.counts[1])
    tree.numbers[new, 3] = tree.buckets[bucket]
    tree.buckets[bucket] = new
    tree.table[slot] = new
    tree.counts[0] += 1


@allocation_free
def _after(around: Surroundings, pose: Array, turn: int, length: float) -> Any:
    """Pose after an arc, a turn on the spot or a straight line."""
    x, y, heading, radius = pose[0], pose[1], pose[2], around.radius
    if turn == 0:
        way = length * radius
        return x + way * math.cos(heading), y + way * math.sin(heading), heading
    after, side = heading + turn * length, turn * radius
    if around.turns_on_the_spot:
        return x, y, after
    x += side * (math.sin(after) - math.sin(heading))
    y -= side * (math.cos(after) - math.cos(heading))
    return x, y, after


@allocation_free
def _slot_of(tree: Tree, cell: IntArray) -> int:
    """Place of a cell in the table: its own, or the free one where it belongs."""
    mask = tree.table.shape[0] - 1
    mixed = 0
    for i in range(cell.shape[0]):
        mixed = (mixed ^ cell[i]) * _MIXER
    slot: int = (mixed ^ mixed >> 17) & mask
    while tree.table[slot] >= 0 and not _are_equal(tree.cells[tree.table[slot]], cell):
        slot = (slot + 1) & mask
    return slot


@allocation_free
def _are_equal(cell: IntArray, other: IntArray) -> bool:
    different = 0
    for i in range(cell.shape[0]):
        different += cell[i] != other[i]
    return different == 0


@allocation_free
def _is_clear(around: Surroundings, x: float, y: float, heading: float) -> bool:
    """True if no disc of the robot is nearer to anything than it may be."""
    road, shapes, radii, discs = around.space
    for i in range(discs.shape[0]):
        at_x, at_y = point_of(x, y, heading, discs, i)
        place = road_functions.project(road, at_x, at_y, heading, math.nan)
        _, _, over, other = road_functions.lateral_error(road, 0, at_x, at_y, place)
        if not (over <= around.depth and other <= around.depth):
            return False
        for j in range(radii.shape[1]):
            away = distance_from(shapes, 0, j, at_x, at_y)
            if not away - radii[0, j] >= -around.depth:
                return False
    return True
