"""The work of a control step is bounded, and what it does not suffice for is not followed."""

from __future__ import annotations

import numpy as np
import pytest
from scenarios import law_of

from cmpsp_ros.guidance import FallbackLevel, Observation
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file

START = np.array([0.0, -9.25, 0.0])


@pytest.mark.parametrize('candidates', [1, 4])
@pytest.mark.parametrize('work_rate', [1e6, 4e7])
def test_a_first_plan_that_runs_out_of_work_is_a_stop_with_its_reason(candidates, work_rate):
    """A thousand steps of 10 ms: the guess passes the audit, the iterations improve nothing."""
    changes = {'control_period': 0.01, 'solver.candidates': candidates}
    changes['solver.work_rate'] = work_rate
    law = law_of(guidance_settings(TABLE.resolve(load_parameter_file('case3') | changes)))
    for stamp in (0, 10_000_000):
        decision = law.step(Observation(stamp, START))
        assert decision.level == FallbackLevel.STOP
        assert decision.reason.startswith('The work of this control step was used up')
        assert decision.plan is None
        assert not decision.twist.any()
