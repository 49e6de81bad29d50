"""The guidance law: from odometry to commands as a pure state machine, without ROS."""

from typing import TYPE_CHECKING

from cmpsp_ros.front_door import lazy_exports

if TYPE_CHECKING:
    from cmpsp_ros.guidance.decision import (
        DECISION_KEYS,
        FIELDS,
        Decision,
        FallbackLevel,
        Key,
        Plan,
        decision_to_key_values,
        exact_repr,
        is_at_rest,
        response_ms,
        severity,
        truth,
        waypoints,
    )
    from cmpsp_ros.guidance.goals import Follow, Goal, GoalError
    from cmpsp_ros.guidance.horizon import remaining, shift
    from cmpsp_ros.guidance.law import GuidanceLaw
    from cmpsp_ros.guidance.prediction.estimator import Observation
    from cmpsp_ros.guidance.settings import GOAL, LawSettings
    from cmpsp_ros.guidance.solver_settings import (
        InitialGuess,
        MovingObstacles,
        Safety,
        SolverSettings,
        TaskSettings,
        Weights,
    )
    from cmpsp_ros.guidance.times import NANOSECONDS, NEVER, Horizon, to_nanoseconds
    from cmpsp_ros.guidance.warmup import prepare, warm_up
    from cmpsp_ros.guidance.world import MAP, SEEN, GuidanceSettings, World

__getattr__, __all__ = lazy_exports(__name__, __file__)
