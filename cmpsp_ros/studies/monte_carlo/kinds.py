"""The kinds of studies: what is drawn, and which parameters it is driven with."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

from cmpsp_ros.guidance import GuidanceSettings
from cmpsp_ros.studies.monte_carlo.courses.cylinders import field_scenario
from cmpsp_ros.studies.monte_carlo.courses.random_courses import corridor_scenario, floor_scenario
from cmpsp_ros.studies.monte_carlo.courses.rooms import room_scenario
from cmpsp_ros.studies.monte_carlo.courses.scenario import Scenario, paper_scenario, scenario

PRESET: Final = 'case3'
_SEEING: Final = {
    'road.type': 'none',
    'goal.may_be_late': True,
    'goal.tolerance': 0.05,
    'robot.max_wheel_speed': 28.0,
    'sensors.front.reach': 8.0,
    'sim.scan.angle_min': -0.75 * math.pi,
    'sim.scan.angle_max': 0.75 * math.pi,
    'sim.scan.count': 541,
    'sim.scan.dropout': 0.0,
    'sight.size': 16.0,
    'sight.memory': 600.0,
    'solver.work_share': 0.2,
}

# A Jackal as in the BARN challenge, at no more than 1 m/s: its score asks for half of that.
_CLUTTERED: Final = {
    **_SEEING,
    'control_period': 0.1,
    'goal.tolerance': 0.1,
    'robot.wheel_radius': 0.098,
    'robot.half_track': 0.2817,
    'robot.max_wheel_speed': 10.2,
    'robot.max_wheel_acceleration': 50.0,
    'robot.radius': 0.333,
    'safety.margin': 0.005,
    'safety.stopping_time': 0.2,
    'sim.scan.stddev': 0.001,
    'sight.size': 8.0,
    'sight.resolution': 0.025,
}

_WITH_A_BODY: Final = {'robot.radius': 0.1, 'safety.margin': 0.02}


@dataclass(frozen=True)
class Kind:
    """The properties of one kind of study.

    Attributes:
        changes: Parameters that differ from those of the preset.
        tolerance: Largest miss that counts as arrived [m].
        draw: Makes a scenario from the settings, the seed, its number and the most obstacles.
        lateness: Longest time that a control step takes, in control periods.
        lag: Least and greatest time constant of the wheels, drawn for each run [s]; None for that
            of the parameters.
        preset: What the changes are made to.
        sees: Whether the law knows nothing of obstacles but what a scanner shows.
        has_map: Whether it knows them from a map, and what it takes is compared with the shortest
            path.
        is_foreign: Whether the robot is a `ForeignRobot`, and the law is told wrong about it.
        score_speed: Of the straight way, for the score of the BARN challenge [m/s]; None for none.
    """

    changes: Mapping[str, Any]
    tolerance: float
    draw: Callable[[GuidanceSettings, int, int, int], Scenario] = scenario
    lateness: float = 0.0
    lag: tuple[float, float] | None = None
    preset: str = PRESET
    sees: bool = False
    has_map: bool = False
    is_foreign: bool = False
    score_speed: float | None = None

    @property
    def has_own_roads(self) -> bool:
        """Whether each run has another road."""
        return self.draw not in {scenario, paper_scenario}


KINDS: Final[Mapping[str, Kind]] = MappingProxyType(
    {
        'nominal': Kind({}, 1e-3),
        'disturbed': Kind(
            {
                'noise.position_stddev': 0.005,
                'noise.heading_stddev': math.radians(0.5),
                'wheel_lag': 0.05,
                'wheel_slip': [0.03, 0.03],
                'actuation_delay': 0.06,
                # What the wheels lag comes to as much.
                'command_delay': 0.11,
                'max_wheel_slip': 0.1,
                'safety.margin': 0.05,
            },
            0.05,
        ),
        # Steps take between nothing and the longest time, and the delay is known on the average.
        'realtime': Kind(
            {'command_delay': 0.1, 'max_command_delay': 0.3, 'safety.margin': 0.05},
            0.05,
            lateness=1.5,
        ),
        # The law is told how much the wheels lag at most, and estimates by how much they do.
        'heavy': Kind(
            {'robot.max_wheel_acceleration': 60.0, 'max_wheel_lag': 0.3, 'safety.margin': 0.05},
            0.05,
            lag=(0.1, 0.3),
        ),
        # A robot without shared code, and a delay that is told wrong by up to 100 ms. The weight
        # keeps plans from commands that a robot which lags cannot follow.
        'told_wrong': Kind(
            {'safety.margin': 0.05, 'weights.control_rate': 0.01},
            0.05,
            paper_scenario,
            is_foreign=True,
        ),
        'corridors': Kind(_WITH_A_BODY, 1e-3, corridor_scenario),
        'floor': Kind(_WITH_A_BODY, 1e-3, floor_scenario),
        'sight': Kind(_SEEING, 0.05, room_scenario, preset='unknown', sees=True),
        'mapped': Kind(_SEEING, 0.05, room_scenario, preset='unknown', has_map=True),
        'clutter': Kind(
            _CLUTTERED, 0.1, field_scenario, preset='unknown', sees=True, score_speed=2.0
        ),
    }
)
