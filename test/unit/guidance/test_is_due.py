"""Odometry that calls for a decision, told before it is decided on."""

import numpy as np
from scenarios import CASES, PERIOD, START

from cmpsp_ros.guidance import GuidanceLaw, Observation


def test_it_foretells_whether_there_is_a_decision():
    law, begin, pose = (
        GuidanceLaw(CASES['case 3'], CASES['case 3'].world),
        1_000_000_007,
        np.array(START),
    )
    offsets = [0, 1, PERIOD // 2, PERIOD - 1, PERIOD, PERIOD, 0, 3 * PERIOD, 49 * PERIOD]
    stamps = [begin + offset for offset in [*offsets, 50 * PERIOD, 50 * PERIOD + 1, 51 * PERIOD]]
    foretold, decided = [], []
    for stamp in stamps:
        foretold.append(law.is_due(stamp))
        decided.append(law.step(Observation(stamp, pose)) is not None)
    assert foretold == decided
    assert decided == [True, *[False] * 3, True, *[False] * 2, *[True] * 3, False, True]


def test_after_a_halt_the_next_newer_odometry_is_due():
    law, pose = GuidanceLaw(CASES['case 3'], CASES['case 3'].world), np.array(START)
    law.step(Observation(0, pose))
    assert not law.is_due(1)
    law.halt(1, 'Why not.')
    assert law.is_due(1)
    assert not law.is_due(0)
    law.reset()
    assert law.is_due(0)
