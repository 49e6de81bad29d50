"""How much of the solver's work this computer does in a second."""

from __future__ import annotations

import math
import time
from typing import Final

import numpy as np

from cmpsp_ros.guidance.horizon import remaining, to_nanoseconds
from cmpsp_ros.guidance.initial_guess import along_road
from cmpsp_ros.guidance.planner import Planner
from cmpsp_ros.parameters.catalogue import TABLE
from cmpsp_ros.parameters.presets import load_parameter_file
from cmpsp_ros.parameters.robots import load_robot
from cmpsp_ros.parameters.settings import guidance_settings

# Many bounds on a long horizon: where work is what takes the time.
_PRESET, _ROBOT, _CHANGES = 'case3_wide', 'turtlebot3_waffle', {'final_time': 68.0}
_RUNS: Final = 20


def work_rate() -> float:
    """Visits of a stage in a second [1/s], to two digits: the parameter `solver.work_rate`.

    The median of some plans made from scratch, the work of the problem's functions included.
    """
    given = load_parameter_file(_PRESET) | load_robot(_ROBOT) | _CHANGES
    settings = guidance_settings(TABLE.resolve(given))
    planner, pose, held = Planner(settings), settings.road.middle(), np.zeros(2)
    final, period = to_nanoseconds(settings.final_time), to_nanoseconds(settings.control_period)
    horizon = remaining(0, period, final)
    guess = along_road(settings, pose, horizon.durations)
    rates = []
    for _ in range(_RUNS):
        planner.forget()
        began = time.perf_counter()
        work = planner.improve(pose, held, guess, horizon).work
        rates.append(work / (time.perf_counter() - began))
    rate = float(np.median(rates))
    digits = 10.0 ** (math.floor(math.log10(rate)) - 1)
    return round(rate / digits) * digits
