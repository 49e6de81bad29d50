"""Distances at the samples that keep the arcs between them clear: enough, and no more."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st

from cmpsp_ros.robots import DifferentialDrive, TwistLimits
from cmpsp_ros.robots.motion import arc_ends
from cmpsp_ros.world import outside
from cmpsp_ros.world.inter_sample_margin import inside, inside_known, outside_known

ROBOT = DifferentialDrive(max_wheel_speed=51.0).twist_limits()
TURNS_SLOWLY = TwistLimits(1.785, 0.3)
TURNS_NEVER = TwistLimits(1.785, 0.0)
FREE = TwistLimits(2.0, 12.0)
LIMITS = [ROBOT, TURNS_SLOWLY, TURNS_NEVER, FREE]
unhurried = hypothesis_settings(deadline=None, max_examples=250)
shares = st.floats(-1.0, 1.0)


def arc(limits, speed_share, turn_share, period):
    """A twist within the limits, and the ends of its arc from the origin along x."""
    turn_rate = turn_share * limits.turn_rate
    speed = speed_share * max(0.0, limits.speed - limits.half_track * abs(turn_rate))
    twist = np.array([[speed, turn_rate]])
    end = arc_ends(np.zeros((1, 3)), twist, np.array([period]))[0, :2]
    return twist, end


def on_circle(center, radius, angle):
    return center + radius * np.array([math.cos(angle), math.sin(angle)])


def driven(twist, period, point):
    """Least and greatest distance from a point along an arc, from 2001 places on it."""
    times = np.linspace(0.0, period, 2001)
    places = arc_ends(np.zeros((2001, 3)), np.repeat(twist, 2001, axis=0), times)[:, :2]
    distance = np.linalg.norm(places - point, axis=1)
    return distance.min(), distance.max()


@unhurried
@given(
    limits=st.sampled_from(LIMITS),
    speed_share=shares,
    turn_share=shares,
    distance=st.floats(0.0, 15.0),
    period=st.floats(0.02, 1.0),
    angle=st.floats(-math.pi, math.pi),
    from_end=st.booleans(),
    known=st.booleans(),
)
def test_outside_is_enough(
    limits, speed_share, turn_share, distance, period, angle, from_end, known
):
    twist, end = arc(limits, speed_share, turn_share, period)
    kept = outside(distance, limits, period)
    if known:
        kept = outside_known(np.array([distance]), twist, period)[0, 0]
    # The point is at exactly the distance allowed from one end, and no nearer to the other.
    near, far = (end, np.zeros(2)) if from_end else (np.zeros(2), end)
    point = on_circle(near, kept, angle)
    assume(math.dist(point, far) >= kept)
    assert driven(twist, period, point)[0] >= distance - 1e-9


@unhurried
@given(
    limits=st.sampled_from([ROBOT, FREE, TURNS_NEVER]),
    speed_share=shares,
    turn_share=shares,
    distance=st.floats(0.5, 15.0),
    period=st.floats(0.02, 0.25),
    share=st.floats(0.9, 1.0),
    angle=st.floats(-math.pi, math.pi),
    from_end=st.booleans(),
    known=st.booleans(),
)
def test_inside_is_enough(
    limits, speed_share, turn_share, distance, period, share, angle, from_end, known
):
    twist, end = arc(limits, speed_share, turn_share, period)
    kept = inside_known(distance, twist, period)[0] if known else inside(distance, limits, period)
    far, near = (end, np.zeros(2)) if from_end else (np.zeros(2), end)
    point = on_circle(far, share * kept, angle)
    assume(math.dist(point, near) <= kept)
    assert driven(twist, period, point)[1] <= distance + 1e-9


@pytest.mark.parametrize('distance', [0.02, 0.05, 0.1, 0.2, 0.3])
def test_inside_of_a_small_disc(distance):
    """Discs of the size of one period's drive, for arcs up to several circles."""
    rng = np.random.default_rng(0)
    kept = inside(distance, FREE, 0.3)
    for _ in range(400):
        twist, end = arc(FREE, *rng.uniform(-1.0, 1.0, size=2), 0.3)
        point = on_circle(np.zeros(2), kept * math.sqrt(rng.random()), rng.uniform(0.0, 7.0))
        if math.dist(point, end) <= kept:
            assert driven(twist, 0.3, point)[1] <= distance + 1e-9


def middles(limits, period, count=40_000):
    """Radius and half angle of full-speed arcs up to a whole circle, finely spaced."""
    largest = min(math.pi, limits.turn_rate * period / 2.0)
    a = np.linspace(0.0, largest, count + 1)[1:]
    w = 2.0 * a / period
    return np.maximum(limits.speed - limits.half_track * w, 0.0) / w, a


@pytest.mark.parametrize('limits', [ROBOT, TURNS_SLOWLY, FREE])
@pytest.mark.parametrize('distance', [0.0, 0.5, 0.7, 9.0])
@pytest.mark.parametrize('period', [0.05, 0.2, 0.5])
def test_outside_is_attained(limits, distance, period):
    kept = outside(distance, limits, period)
    R, a = middles(limits, period)
    # Beside the middle, `kept` from both ends, in coordinates about the arc's centre.
    beyond = R * np.cos(a) + np.sqrt(np.maximum(kept**2 - (R * np.sin(a)) ** 2, 0.0))
    nearest = np.where(R * np.sin(a) <= kept, beyond - R, np.inf)
    straight = math.sqrt(max(kept**2 - (limits.speed * period / 2.0) ** 2, 0.0))
    nearest = np.append(nearest, straight)
    assert nearest.min() == pytest.approx(distance, abs=1e-6)
    assert nearest.min() >= distance - 1e-9


@pytest.mark.parametrize('limits', [ROBOT, FREE])
@pytest.mark.parametrize('distance', [1.0, 2.0, 11.0])
@pytest.mark.parametrize('period', [0.05, 0.2, 0.4])
def test_inside_is_attained(limits, distance, period):
    kept = inside(distance, limits, period)
    assert 0.0 < kept < distance
    R, a = middles(limits, period)
    # On the far side of the arc's centre from its middle, `kept` from both ends.
    offset = -R * np.cos(a) + np.sqrt(np.maximum(kept**2 - (R * np.sin(a)) ** 2, 0.0))
    furthest = np.where((R * np.sin(a) <= kept) & (offset >= 0.0), offset + R, 0.0)
    assert furthest.max() == pytest.approx(distance, abs=1e-6)


@unhurried
@given(
    limits=st.sampled_from([ROBOT, TURNS_NEVER, FREE]),
    speed_share=shares,
    turn_share=shares,
    distance=st.floats(1.0, 15.0),
    period=st.floats(0.02, 0.3),
)
def test_known_arcs_need_no_more_than_the_worst(limits, speed_share, turn_share, distance, period):
    twist, _ = arc(limits, speed_share, turn_share, period)
    # A straight line counts as an arc that turns a micro-radian a second.
    slack = 1e-6
    known = outside_known(np.array([distance]), twist, period)[0, 0]
    assert distance <= known <= outside(distance, limits, period) + slack
    known = inside_known(distance, twist, period)[0]
    assert distance >= known >= inside(distance, limits, period) - slack


@pytest.mark.parametrize(
    ('place', 'bad'),
    [*((place, bad) for place in range(3) for bad in (math.nan, math.inf)), (0, -1.0), (1, -1.0)],
)
def test_limits_must_be_finite_and_speeds_not_negative(place, bad):
    bounds = [1.0, 1.0, 1.0]
    bounds[place] = bad
    with pytest.raises(ValueError, match='wanted finite numbers, speed and turn rate >= 0'):
        TwistLimits(*bounds)
