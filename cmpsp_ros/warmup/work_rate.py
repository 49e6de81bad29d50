"""How much of the solver's work this computer does in a second."""

from __future__ import annotations

import math
import time
from typing import Final

import numpy as np

from cmpsp_ros.mpsp.jit import entry_for
from cmpsp_ros.mpsp.qp.active_set import empty_active_set, empty_warm_start, solve
from cmpsp_ros.mpsp.qp.riccati import empty_program

# Sizes of the guidance law, on a long horizon.
_SIZES: Final = (400, 3, 2, 2, 4)
_RUNS: Final = 21


def work_rate() -> float:
    """Visits of a stage in a second [1/s], to two digits: the parameter `solver.work_rate`.

    The median of some solutions, from scratch, of one program with many active bounds.
    """
    p, active, warm = empty_program(*_SIZES), empty_active_set(*_SIZES), empty_warm_start(*_SIZES)
    rng, stages = np.random.default_rng(1), p.stages
    stages['A'], stages['L_XX'], stages['L_UU'] = np.eye(3), np.eye(3), np.eye(2)
    stages['B'] = 0.1 * rng.standard_normal(stages['B'].shape)
    stages['L_X'] = rng.standard_normal(stages['L_X'].shape)
    stages['lower'], stages['upper'] = -0.5, 0.5
    p.path['value'] = -math.inf
    p.terminal['X'][:, :2] = np.eye(2)
    enter, rates = entry_for(solve, p, active, warm), []
    for _ in range(_RUNS):
        warm.clear()
        p.head['work'] = p.head['is_factorised'] = 0
        began = time.perf_counter()
        enter(p, active, warm)
        rates.append(int(p.head['work'][0]) / (time.perf_counter() - began))
    rate = float(np.median(rates))
    digits = 10.0 ** (math.floor(math.log10(rate)) - 1)
    return round(rate / digits) * digits
