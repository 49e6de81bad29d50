"""The response in closed form, beside one that is integrated in small steps."""

import numpy as np
import pytest

from cmpsp_ros.bags import BagError
from cmpsp_ros.bags.identify import RADIUS, excitation
from cmpsp_ros.bags.identify.model import Response
from cmpsp_ros.robots.motion import arc_ends

CHANGES = np.array([0.0, 0.5, 0.7, 0.75, 1.6])
COMMANDS = np.array([0.1, 1.0, -0.8, 0.3, 0.0])
STEP = 1e-5


def integrated(response, stamps):
    first = response.lag / (1.0 + response.ratio)
    second = response.ratio * first
    y = speed = response.scale * COMMANDS[0]
    distance, found = 0.0, []
    times = np.arange(0.0, stamps[-1] + STEP, STEP)
    # The first command has always been in effect.
    index = np.maximum(np.searchsorted(CHANGES + response.delay, times, side='right') - 1, 0)
    limit, most = response.max_speed, response.max_acceleration
    targets = np.clip(response.scale * COMMANDS, -limit, limit)[index]
    for target in targets.tolist():
        found.append((distance, speed))
        rate = (target - y) / first
        y += STEP * min(max(rate, -most), most)
        distance += STEP * speed
        speed = speed + STEP * (y - speed) / second if second else y
    rows = np.round(stamps / STEP).astype(int)
    return np.array(found)[rows].T


@pytest.mark.parametrize(
    'response',
    [
        Response(0.1, 0.15),
        Response(0.0, 0.2, 0.5, 0.9),
        Response(0.0333, 0.05, 0.0, 1.2, 0.7),
        Response(0.05, 0.1, 0.2, 1.0, 0.9, 3.0),
        Response(0.05, 0.02, 0.0, 1.0, np.inf, 2.0),
    ],
)
def test_distance_and_speed_are_those_of_the_differential_equation(response):
    stamps = np.linspace(0.0, 2.5, 51)
    distance, speed = response.travel(CHANGES, COMMANDS, stamps)
    wanted = integrated(response, stamps)
    assert distance - distance[0] == pytest.approx(wanted[0], abs=2e-4)
    assert speed == pytest.approx(wanted[1], abs=2e-3)


def test_without_lag_the_speed_is_the_command():
    speed = Response(0.1).travel(CHANGES, COMMANDS, np.array([0.0, 0.59, 0.61, 2.0]))[1]
    assert speed == pytest.approx([0.1, 0.1, 1.0, 0.0])


def test_the_excitation_takes_20_s_and_ends_at_rest_within_the_circle():
    ends, twists = excitation(0.5, 1.5)
    assert ends[-1] == pytest.approx(20.0)
    assert not twists[-1].any()
    path = arc_ends
    pose, farthest = np.zeros((1, 3)), 0.0
    for twist, lasts in zip(twists, np.diff(ends, prepend=0.0), strict=True):
        pose = path(pose, twist[None], np.array([lasts]))
        farthest = max(farthest, np.hypot(*pose[0, :2]))
    assert 0.1 < farthest < RADIUS


def test_an_excitation_that_needs_more_than_the_circle_is_refused():
    with pytest.raises(BagError, match=r'--max-speed.*found a way of .* at 2 m/s and 1 rad/s'):
        excitation(2.0, 1.0)
