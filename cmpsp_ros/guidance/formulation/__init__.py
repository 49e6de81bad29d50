"""The optimal control problem of a control step."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.guidance.formulation.guidance_problem import (
        FUNCTIONS,
        GuidanceProblem,
        guidance_data,
    )
    from cmpsp_ros.guidance.formulation.ocp_formulation import (
        PENALTIES,
        OcpFormulation,
        goal_space,
        sample_space,
    )
    from cmpsp_ros.guidance.formulation.ocp_functions import N_EDGE_CONSTRAINTS, GuidanceData

__getattr__, __all__ = lazy_exports(__name__, __file__)
