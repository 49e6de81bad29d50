"""Where on a road the robot's centre may be: one type for every kind of road.

Compiled code tells the kinds apart by a number, so that it is compiled once for all of them; see
`road_functions`.
"""

from __future__ import annotations

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.arrays import Array, BoolArray
from cmpsp_ros.robots import TwistLimits
from cmpsp_ros.world.inter_sample_margin import (
    at_ends,
    bent_edge_margin,
    bent_edge_margin_known,
    inside,
    inside_known,
    outside,
    outside_known,
)

Records = NDArray[np.void]

OPEN_FLOOR, ANNULUS, CORRIDOR = 0, 1, 2
"""Kinds of road."""

SHAPE: Final = np.dtype(
    [
        ('kind', np.int64),
        # Annulus: the centre of both circles and the radius of the centre line [m].
        ('center_x', np.float64),
        ('center_y', np.float64),
        ('center_radius', np.float64),
        # Corridor: the length of the centre line [m] and the longest step of a projection [m].
        ('length', np.float64),
        ('stride', np.float64),
        # Length up to which an arc between two points of the road is sure not to leave the
        # surroundings in which every point has a unique projection onto the centre line [m].
        ('room', np.float64),
        # Weight of a heading where the road crosses itself [m].
        ('decides', np.float64),
        # Progress from one station to the next; the first has progress 0 [m].
        ('station_step', np.float64),
        # Number of the cells of `PIECE` in a metre [1/m].
        ('cells_in_metre', np.float64),
        # What a clearance measured across the road counts, for either edge: less than 1 where the
        # width changes.
        ('part', np.float64, (2,)),
        # Greatest second derivative of either clearance along any straight line [1/m].
        ('bend', np.float64, (2,)),
        # Whether the road ends where it begins.
        ('closed', np.bool_),
    ]
)
"""Scalars of a road; those of another kind are 0."""

PIECE: Final = np.dtype(
    [
        # Progress where the piece begins [m].
        ('begin', np.float64),
        # Four cubic polynomials of the progress since then, lowest power first: x, y, and the
        # widths to the left and to the right [m].
        ('curves', np.float64, (4, 4)),
        # The whole progress has as many equal cells as there are pieces. This is the number of the
        # piece that the cell of this number begins with.
        ('at_cell', np.int64),
    ]
)
"""A piece of a corridor's centre line."""


class RoadSpace(NamedTuple):
    """Where on a road the robot's centre may be.

    The first edge is the outer one of an annulus and the left one of a corridor.

    Attributes:
        shape: One record of `SHAPE`, shape ``(1,)``. It is shared and never written to.
        kept: For both edges, for all stages or for each of them, shape ``(K, 2)`` [m]: of an
            annulus the greatest and the least distance from the centre, of a corridor the
            clearance to keep.
        pieces: Of a corridor's centre line, records of `PIECE` with one more at the end for where
            the last piece ends, shape ``(S + 1,)``.
        stations: Places on a corridor's centre line, close together: x, y, and the direction there
            (cosine, sine), shape ``(Z, 4)`` [m, m, 1, 1].
    """

    shape: Records
    kept: Array
    pieces: Records
    stations: Array

    @property
    def kind(self) -> int:
        """`ANNULUS`, `CORRIDOR` or `OPEN_FLOOR`."""
        return int(self.shape['kind'][0])

    def tightened(self, limits: TwistLimits, period: float) -> RoadSpace:
        """See `FreeSpace.tightened`."""
        if self.kind == ANNULUS:
            outer, inner = self.kept[0].tolist()
            edges = [inside(outer, limits, period), outside(inner, limits, period)]
            return self._replace(kept=np.array([edges]))
        if self.kind == CORRIDOR:
            grown = [
                bent_edge_margin(bend, limits, period) for bend in self.shape['bend'][0].tolist()
            ]
            return self._replace(kept=self.kept + np.array([grown]))
        return self

    def for_samples_of(self, twists: Array, period: float) -> RoadSpace:
        """See `FreeSpace.for_samples_of`."""
        if self.kind == ANNULUS:
            outer = inside_known(float(self.kept[0, 0]), twists, period)
            inner = outside_known(self.kept[:, 1], twists, period)[:, 0]
            edges = at_ends(np.minimum, outer), at_ends(np.maximum, inner)
            return self._replace(kept=np.column_stack(edges))
        if self.kind == CORRIDOR:
            grown = at_ends(
                np.maximum, bent_edge_margin_known(self.shape['bend'][0], twists, period)
            )
            return self._replace(kept=self.kept + grown)
        return self

    def with_some(self, samples: BoolArray, of: RoadSpace) -> RoadSpace:
        """See `FreeSpace.with_some`."""
        return self._replace(kept=np.where(samples[:, None], of.kept, self.kept))


def road_space(
    kind: int,
    kept: tuple[float, float] = (0.0, 0.0),
    pieces: Records | None = None,
    stations: Array | None = None,
    **scalars: Any,
) -> RoadSpace:
    """A road for compiled code.

    Args:
        kind: `ANNULUS`, `CORRIDOR` or `OPEN_FLOOR`.
        kept: As in `RoadSpace`, for all stages [m].
        pieces: As in `RoadSpace`.
        stations: As in `RoadSpace`.
        scalars: Fields of `SHAPE`.
    """
    shape = np.zeros(1, SHAPE)
    shape['kind'] = kind
    for name, value in scalars.items():
        shape[name] = value
    return RoadSpace(
        shape,
        np.array([kept], dtype=float),
        np.zeros(1, PIECE) if pieces is None else pieces,
        np.zeros((1, 4)) if stations is None else stations,
    )
