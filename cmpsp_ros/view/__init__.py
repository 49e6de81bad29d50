"""The live page, and colours and drawing for all pictures; without ROS."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.view.drawing import PER_ARC, along, draw, legend_below, show
    from cmpsp_ros.view.plotly_traces import (
        arrow,
        coordinates,
        ends,
        goals_trace,
        grid_picture,
        hover,
        number,
        numbers,
        trace,
        traces,
    )
    from cmpsp_ros.view.scene import (
        BAGS,
        EDGE,
        GOAL,
        GRID,
        LEVEL_COLORS,
        LIMIT,
        LOOKS,
        MOVING,
        OBSTACLE,
        PERSON,
        SEEN,
        SIGMAS,
        TEXT,
        UNSEEN,
        Lines,
        Part,
        bag_color,
        bodies,
        body,
        course,
        disc,
        frame,
        kept_clear,
        map_corners,
        seen,
        trail,
    )
    from cmpsp_ros.view.server import SharedState, ViewError, ViewServer

__getattr__, __all__ = lazy_exports(__name__, __file__)
