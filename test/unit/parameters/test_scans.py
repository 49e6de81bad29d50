"""The simulated scanner's parameters: each reaches its place, and what cannot be is refused."""

from __future__ import annotations

import pytest

from cmpsp_ros.parameters import TABLE, ParameterError, laser_settings, shapes_of
from cmpsp_ros.parameters.obstacles import obstacles_of
from cmpsp_ros.world.obstacles import Capsule


def test_obstacles_of_the_simulator_are_no_others():
    block = {'type': 'capsule', 'start': [0, 0], 'end': [1, 0], 'radius': 0.1}
    values = TABLE.resolve(
        {
            'sim.obstacles.names': ['wall'],
            **{f'sim.obstacles.wall.{k}': v for k, v in block.items()},
        }
    )
    assert shapes_of(values) == (Capsule('wall', (0.0, 0.0), (1.0, 0.0), 0.1),)
    assert obstacles_of(values) == ()


@pytest.mark.parametrize(
    ('changes', 'line'),
    [
        (
            {'sim.scan.angle_min': 1.0, 'sim.scan.angle_max': 0.5},
            'sim.scan.angle_max: found 0.5 rad, wanted more than sim.scan.angle_min = 1.0 rad, by '
            'a full turn at most',
        ),
        (
            {'sim.scan.range_min': 2.0, 'sim.scan.range_max': 1.0},
            'sim.scan.range_max: found 1.0 m, wanted more than sim.scan.range_min = 2.0 m',
        ),
        (
            {'sim.scan.count': 11, 'sim.scan.time_increment': 0.02},
            'sim.scan.time_increment: found 0.02 s, wanted at most 0.01 s, for a scan within '
            '1 / sim.scan.rate = 0.1 s',
        ),
        (
            {'sim.obstacles.names': ['wall']},
            'sim.obstacles.wall.center: found nothing, wanted a list of 2 numbers [m]',
        ),
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused(changes, line):
    with pytest.raises(ParameterError) as refused:
        laser_settings(TABLE.resolve({'sim.scan.rate': 10.0, **changes}))
    assert line in str(refused.value).splitlines()
