"""Obstacles, at rest and moving, and exact distances from them."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.world.obstacles.moving_discs import (
        NOTHING_MOVES,
        MovingDiscs,
        disc_after,
        put_clearance,
        sweep_moving,
    )
    from cmpsp_ros.world.obstacles.shape_functions import (
        ROUGHNESS,
        ShapeData,
        away_from,
        distance_from,
        sweep,
    )
    from cmpsp_ros.world.obstacles.shapes import (
        SHAPES,
        Capsule,
        Obstacle,
        Point,
        Shape,
        ShapeError,
        convex,
        outline_of,
    )

__getattr__, __all__ = lazy_exports(__name__, __file__)
