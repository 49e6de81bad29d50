"""A road that a wall closes from edge to edge: the robot stops before it, and stays."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scenarios import PERIOD, ROAD, SECOND, drive, reconfigure, settings
from test_command_delay import Drive

from cmpsp_ros.guidance import Goal, GuidanceLaw
from cmpsp_ros.world.obstacles import Capsule

OPEN = settings(limit=51.0, guess=ROAD)
CLOSED = 'The road is closed at obstacle wall: the robot waits before it.'


def wall(bearing, slant=0.0, radius=0.05):
    """From inside the inner edge to outside the outer one."""
    ends = zip((8.9, 11.1), np.radians([bearing, bearing + slant]), strict=True)
    start, end = ((r * math.cos(angle), r * math.sin(angle)) for r, angle in ends)
    return Capsule('wall', start, end, radius)


def closed(**how):
    return replace(OPEN, obstacles=(wall(-70.0, **how),))


@pytest.mark.parametrize('lag', [0.0, 0.2])
@pytest.mark.parametrize('how', [{}, {'slant': 10.0}, {'slant': -10.0}, {'radius': 0.4}])
def test_the_robot_stops_before_a_wall_and_stays(how, lag):
    run = Drive(closed(**how), wheel_lag=lag)
    decisions = [each for each in run.decisions if not each.finished]
    assert run.clearance > 0.01
    first = next(k for k, each in enumerate(decisions) if each.reason.startswith(CLOSED))
    assert first < 25, 'it does not turn about until its time is up'
    assert {each.reason for each in decisions[first + 1 :]} == {CLOSED}
    assert not any(np.any(each.twist) for each in decisions[first:])


@pytest.mark.parametrize('gone', [True, False], ids=['no wall', 'a goal on this side'])
def test_it_drives_on_when_it_can(gone):
    given, near = replace(closed(), final_time=20.0), (0.4, -10.2)
    law = GuidanceLaw(given, given.world)

    def before(run, stamp):
        if stamp == 60 * PERIOD:
            assert run.decisions[-1].reason == CLOSED
            if gone:
                reconfigure(law, replace(given, obstacles=(SECOND,)))
            else:
                law.set_goal(stamp, Goal(near, math.nan))

    run = drive(law, given, [k * PERIOD for k in range(101)], before=before)
    assert run.decisions[-1].finished
    assert run.miss(given.goal if gone else near) < 0.01
