"""The optimal control problem of a control step."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.guidance.formulation.guidance_problem import GuidanceProblem, guidance_data
    from cmpsp_ros.guidance.formulation.ocp_formulation import (
        PENALTIES,
        OcpFormulation,
        goal_space,
        sample_space,
    )
    from cmpsp_ros.guidance.formulation.ocp_functions import N_EDGE_CONSTRAINTS, GuidanceData
    from cmpsp_ros.guidance.formulation.rate_problem import FUNCTIONS

__getattr__, __all__ = lazy_exports(__name__, __file__)
