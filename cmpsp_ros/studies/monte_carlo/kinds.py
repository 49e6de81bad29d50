"""Kinds of studies: their parameters, their courses, and what counts as arrived."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

from cmpsp_ros.guidance import GuidanceSettings
from cmpsp_ros.studies.monte_carlo.courses.corridors import corridor_scenario, floor_scenario
from cmpsp_ros.studies.monte_carlo.courses.ring_courses import Scenario, paper_scenario, scenario
from cmpsp_ros.studies.monte_carlo.courses.rooms import field_scenario, maze_scenario, room_scenario

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

# A Jackal with its corners at 2 m/s, as in the BARN challenge, with wheels that lag and noise.
_CLUTTERED: Final = {
    **_SEEING,
    'control_period': 0.1,
    'goal.tolerance': 0.1,
    'robot.wheel_radius': 0.098,
    'robot.half_track': 0.2817,
    'robot.max_wheel_speed': 20.4,
    'robot.max_wheel_acceleration': 50.0,
    'robot.radius': 0.0,
    'robot.footprint': '[[0.254, 0.215], [-0.254, 0.215], [-0.254, -0.215], [0.254, -0.215]]',
    'safety.margin': 0.02,
    'safety.stopping_time': 0.2,
    'max_wheel_lag': 0.05,
    'wheel_lag': 0.05,
    'noise.position_stddev': 0.005,
    'noise.heading_stddev': math.radians(0.3),
    'sim.scan.stddev': 0.01,
    'sight.size': 8.0,
    'sight.resolution': 0.025,
}

# Ends of the room hide nobody, and what has gone is not remembered for long.
_CROWDED: Final = {
    **_SEEING,
    'goal.tolerance': 0.1,
    'moving_obstacles.capacity': 8,
    'sim.scan.stddev': 0.01,
    'sight.memory': 10.0,
}

# Faults of sensors and odometry in a share of the runs among people.
NOISY: Final = {
    'sim.scan.missed_return': 0.3,
    'noise.position_stddev': 0.005,
    'noise.heading_stddev': math.radians(0.3),
}

OWN: Final = 'own'  # robot that is no other but the study's own, at 1 m/s

# Robots that drive among people, and what else they need.
ROBOTS: Final[Mapping[str, Mapping[str, Any]]] = MappingProxyType(
    {
        # Create 3 accelerates so much (create3_sim).
        'turtlebot4': {'robot.max_wheel_acceleration': 25.0},
        OWN: {},
        'jackal': {'robot.max_wheel_acceleration': 25.0, 'control_period': 0.1},
    }
)

_WITH_A_BODY: Final = {'robot.radius': 0.1, 'safety.margin': 0.02}


@dataclass(frozen=True)
class StudyKind:
    """The properties of one kind of study."""

    changes: Mapping[str, Any]  # parameters that differ from those of the preset
    tolerance: float  # maximum terminal error that counts as arrived [m]
    # Makes a scenario from settings, seed, run number and maximum number of obstacles.
    draw: Callable[[GuidanceSettings, int, int, int], Scenario] = scenario
    lateness: float = 0.0  # maximum duration of a control step, in control periods
    # Range of the time constant of the wheels, drawn for each run [s]; None for that of the
    # parameters.
    lag: tuple[float, float] | None = None
    preset: str = PRESET  # that is changed
    sees: bool = False  # true if the law knows obstacles only from a scanner
    # True if the law knows obstacles from a map, and its driving times are compared with the
    # shortest path.
    has_map: bool = False
    is_foreign: bool = False  # true if the robot is a `ForeignRobot`, with a wrong model in the law
    # True if people walk about, and runs take several robots and scenes in turn.
    has_people: bool = False
    # Speed along the planned path, for the score of the BARN challenge [m/s]; or None.
    score_speed: float | None = None

    @property
    def has_own_roads(self) -> bool:
        """True if each run has a road of its own."""
        return self.draw not in {scenario, paper_scenario}


KINDS: Final[Mapping[str, StudyKind]] = MappingProxyType(
    {
        'nominal': StudyKind({}, 1e-3),
        'disturbed': StudyKind(
            {
                'noise.position_stddev': 0.005,
                'noise.heading_stddev': math.radians(0.5),
                'wheel_lag': 0.05,
                'wheel_slip': [0.03, 0.03],
                'actuation_delay': 0.06,
                # The lag of the wheels adds as much.
                'command_delay': 0.11,
                'max_wheel_slip': 0.1,
                'safety.margin': 0.05,
            },
            0.05,
        ),
        # Steps take between nothing and the longest time, and the delay is known on the average.
        'realtime': StudyKind(
            {'command_delay': 0.1, 'max_command_delay': 0.3, 'safety.margin': 0.05},
            0.05,
            lateness=1.5,
        ),
        # The law is told how much the wheels lag at most, and estimates by how much they do.
        'heavy': StudyKind(
            {'robot.max_wheel_acceleration': 60.0, 'max_wheel_lag': 0.3, 'safety.margin': 0.05},
            0.05,
            lag=(0.1, 0.3),
        ),
        # A robot without shared code, and a delay that is told wrong by up to 100 ms. The weight
        # keeps plans from commands that a robot which lags cannot follow.
        'told_wrong': StudyKind(
            {'safety.margin': 0.05, 'weights.control_rate': 0.01},
            0.05,
            paper_scenario,
            is_foreign=True,
        ),
        'corridors': StudyKind(_WITH_A_BODY, 1e-3, corridor_scenario),
        'floor': StudyKind(_WITH_A_BODY, 1e-3, floor_scenario),
        'sight': StudyKind(_SEEING, 0.05, room_scenario, preset='unknown', sees=True),
        'mapped': StudyKind(_SEEING, 0.05, room_scenario, preset='unknown', has_map=True),
        'mazes': StudyKind(_SEEING, 0.05, maze_scenario, preset='unknown', has_map=True),
        'clutter': StudyKind(
            _CLUTTERED, 1.0, field_scenario, preset='unknown', sees=True, score_speed=2.0
        ),
        'people': StudyKind(
            _CROWDED, 0.1, room_scenario, preset='unknown', sees=True, has_people=True
        ),
    }
)
