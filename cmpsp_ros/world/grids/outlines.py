"""The lines around cells, along the edges of the grid."""

from __future__ import annotations

from typing import Any

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray

Node = tuple[int, int]


def loops(cells: BoolArray) -> list[tuple[Array, Array]]:
    """Closed lines with the cells to their left: around them, and around holes in them.

    Args:
        cells: Which cells, shape ``(rows, columns)``.

    Returns:
        Rows and columns of the nodes of each line where it turns, the first again at its end.
    """
    onward = _edges(cells)
    found = []
    while onward:
        begin = next(iter(onward))
        line, step = [begin], onward[begin].pop()
        while True:
            line.append(_after(line[-1], step))
            left = onward[line[-2]]
            if not left:
                del onward[line[-2]]
            if line[-1] == begin:
                break
            ahead = onward[line[-1]]
            # Where cells touch at a corner, the line keeps to the cell that it is around.
            turn = (step[1], -step[0])
            step = ahead.pop(ahead.index(turn) if len(ahead) > 1 and turn in ahead else 0)
        nodes = np.array(line, dtype=float)
        along = np.diff(nodes, axis=0)
        turns = np.append(True, (along[1:] != along[:-1]).any(axis=1))
        found.append((*nodes[np.append(turns, True)].T,))
    return found


def _edges(cells: BoolArray) -> dict[Node, list[Node]]:
    """Steps (rows, columns) that lead on from each node along an edge of the cells."""
    padded = np.pad(cells, 1)
    onward: dict[Node, list[Node]] = {}
    # Below a cell the line leads to greater columns, to the right of it to greater rows.
    for step, begin, beside in (
        ((0, 1), (0, 0), (-1, 0)),
        ((1, 0), (0, 1), (0, 1)),
        ((0, -1), (1, 1), (1, 0)),
        ((-1, 0), (1, 0), (0, -1)),
    ):
        outside = ~np.roll(padded, (-beside[0], -beside[1]), axis=(0, 1))
        for row, column in np.argwhere(padded & outside) - 1 + np.array(begin):
            onward.setdefault((int(row), int(column)), []).append(step)
    return onward


def _after(node: Node, step: Any) -> Node:
    return node[0] + step[0], node[1] + step[1]
