"""Bags: writing, reading, replay, audit and report, without rclpy.

A bag, file or folder that cannot be used is a `BagError`, parameters a `ParameterError`.
"""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.bags.decision_record import DecisionRecord
    from cmpsp_ros.bags.errors import BagError, UnknownTypeError
    from cmpsp_ros.bags.names import Names
    from cmpsp_ros.bags.reader import Bag
    from cmpsp_ros.bags.storage.common import Form
    from cmpsp_ros.bags.writer import BagWriter

__getattr__, __all__ = lazy_exports(__name__, __file__)
