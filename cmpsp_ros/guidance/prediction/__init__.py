"""Prediction before planning: pending commands, slip, moving obstacles."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.guidance.prediction.estimator import PlanStart

__getattr__, __all__ = lazy_exports(__name__, __file__)
