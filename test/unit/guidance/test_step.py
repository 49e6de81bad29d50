"""A nominal control step stays short for whoever reads along: few modules, few changes between."""

import sys
from itertools import pairwise

import numpy as np

from cmpsp_ros.guidance import GuidanceLaw, Observation, to_nanoseconds
from cmpsp_ros.parameters import TABLE, guidance_settings, load_parameter_file


def test_a_nominal_step_runs_through_few_modules():
    settings = guidance_settings(TABLE.resolve(load_parameter_file('case3')))
    law, pose = GuidanceLaw(settings, settings.world), np.array([0.0, -9.25, 0.0])
    files = []

    def note(frame, event, _):
        if event == 'call' and 'cmpsp_ros' in frame.f_code.co_filename:
            files.append(frame.f_code.co_filename)

    period = to_nanoseconds(settings.control_period)
    for step in range(6):
        before = sys.getprofile()
        sys.setprofile(note if step == 5 else before)
        try:
            decision = law.step(Observation(step * period, pose))
        finally:
            sys.setprofile(before)
        law.after_step()
        speeds = decision.wheel_speeds[None]
        pose = settings.robot.roll_out(pose, speeds, np.array([settings.control_period]))[-1]
    files = [each for each in files if '/test/' not in each]
    assert 10 < len(set(files)) <= 20
    assert sum(one != other for one, other in pairwise(files)) <= 40
