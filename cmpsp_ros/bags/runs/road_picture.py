"""A road in a picture."""

from __future__ import annotations

from matplotlib.axes import Axes

from cmpsp_ros.world.roads.road import Road


def draw_road(axes: Axes, road: Road, face: str, edge: str) -> None:
    """Draw the road, its edges and its centre line, below everything else.

    Args:
        axes: Where to.
        road: The road; of open floor there is nothing to be seen.
        face: Colour of the road.
        edge: Colour of its lines.
    """
    axes.fill(*road.area().T, color=face, lw=0.0, zorder=0)
    for line in road.edges():
        axes.plot(*line.T, color=edge, lw=1.0, zorder=1)
    axes.plot(*road.center_line().T, color=edge, lw=1.0, ls=':', zorder=1)
