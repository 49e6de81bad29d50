"""The named studies, and the settings of each of their runs."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from cmpsp_ros.guidance import GuidanceSettings, SolverSettings
from cmpsp_ros.parameters import (
    TABLE,
    guidance_settings,
    laser_settings,
    load_parameter_file,
    plant_settings,
)
from cmpsp_ros.parameters.files import load_robot, parse_assignment
from cmpsp_ros.simulator import LaserSettings, PlantSettings
from cmpsp_ros.studies.common import StudyError
from cmpsp_ros.studies.monte_carlo.corridors import corridor_scenario, floor_scenario
from cmpsp_ros.studies.monte_carlo.eyes import Eyes, map_of
from cmpsp_ros.studies.monte_carlo.foreign_robot import ForeignRobot
from cmpsp_ros.studies.monte_carlo.guesses import shortest_length
from cmpsp_ros.studies.monte_carlo.ring_courses import (
    FROM_EDGE,
    GAP,
    WIDTH,
    Scenario,
    in_proportion,
    paper_scenario,
    robot_scenario,
    scenario,
)
from cmpsp_ros.studies.monte_carlo.rooms import field_scenario, room_scenario

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
class StudyKind:
    """The properties of one kind of study.

    Attributes:
        changes: Parameters that differ from those of the preset.
        tolerance: Maximum terminal error that counts as arrived [m].
        draw: Makes a scenario from settings, seed, run number and maximum number of obstacles.
        lateness: Maximum duration of a control step, in control periods.
        lag: Range of the time constant of the wheels, drawn for each run [s]; None for that of the
            parameters.
        preset: Preset that is changed.
        sees: True if the law knows obstacles only from a scanner.
        has_map: True if the law knows obstacles from a map, and its driving times are compared with
            the shortest path.
        is_foreign: True if the robot is a `ForeignRobot`, with a wrong model in the law.
        score_speed: Speed on the straight path, for the score of the BARN challenge [m/s]; or
            None.
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
        'clutter': StudyKind(
            _CLUTTERED, 0.1, field_scenario, preset='unknown', sees=True, score_speed=2.0
        ),
    }
)


MOST_OBSTACLES: Final = 4

_DRAWN: Final = ('obstacles.', 'sim.obstacles.', 'road.points', 'road.half_width')
"""What presets have and every run draws for itself."""

_PACE: Final = 0.95
"""Mean speed that is asked for with a map, along the shortest path, of the nominal one."""

# The paper's first guess is made for the paper's start, and fewer iterations go with it.
_ALWAYS: Final = {
    'initial_guess.type': 'road',
    'solver.initial_iterations': SolverSettings().initial_iterations,
}


@dataclass(frozen=True)
class Study:
    """A study: every run of it depends only on this value and the run's number.

    Attributes:
        name: Name of its kind.
        seed: Seed of all its scenarios.
        most_obstacles: Maximum number on the road in one run.
        assignments: Further parameters, each as `key=value`.
        robot: Name or file of a robot, for which the courses are made then.
    """

    name: str
    seed: int = 1
    most_obstacles: int = MOST_OBSTACLES
    assignments: tuple[str, ...] = ()
    robot: str = ''

    @property
    def tolerance(self) -> float:
        """Miss up to which a run has arrived [m]."""
        return self.kind.tolerance

    @property
    def kind(self) -> StudyKind:
        """Kind of the study, by name."""
        return KINDS[self.name]

    def values(self) -> dict[str, Any]:
        """All parameters, without obstacles.

        Raises:
            StudyError: There is no study of that name, or there is no room on its road, or it has
                no courses for the robot.
            ParameterError: An assignment is wrong.
        """
        if self.name not in KINDS:
            raise StudyError(f'study: found {self.name!r}, wanted one of {", ".join(KINDS)}')
        given = load_parameter_file(self.kind.preset)
        given = {key: value for key, value in given.items() if not key.startswith(_DRAWN)}
        given |= {**_ALWAYS, **self.kind.changes}
        assigned = dict(parse_assignment(each) for each in self.assignments)
        if self.robot:
            given |= self._fitted(given, assigned)
        values = TABLE.resolve(given | assigned)
        settings = guidance_settings(values)
        plant_settings(values)
        wanted = 'none' if self.kind.sees or self.kind.has_map else 'annulus'
        if values['road.type'] != wanted:
            raise StudyError(f'road.type: found {values["road.type"]}, wanted {wanted}')
        width = settings.road.width
        scale = width / WIDTH
        needed = scale * max(GAP, 2.0 * FROM_EDGE) + 2.0 * settings.robot_radius
        if width <= needed:
            raise StudyError(f'road: found {width:g} m of width, wanted more than {needed:g} m')
        if settings.obstacles:
            raise StudyError('obstacles.names: found obstacles, wanted none: they are drawn')
        return dict(values)

    def _fitted(self, given: Mapping[str, Any], assigned: Mapping[str, Any]) -> dict[str, Any]:
        """The robot, and a course in proportion to it."""
        if self.kind is not KINDS['nominal']:
            raise StudyError(f'--robot: found study {self.name}, wanted nominal: it has its own')
        changes = load_robot(self.robot) | _ALWAYS
        values = TABLE.resolve({**given, **changes, **assigned})
        robot = plant_settings(values).robot
        if not math.isfinite(robot.max_speed):
            raise StudyError('robot.max_wheel_speed: found 0.0, wanted a limit for --robot')
        return changes | in_proportion(robot, given, values['robot.radius'])

    def setup(self) -> tuple[GuidanceSettings, PlantSettings]:
        """Settings of law and plant in every run, but for start, obstacles and seed."""
        return _setup(self)

    def run(self, number: int) -> RunTask:
        """Task of the run of that number."""
        settings, plant = self.setup()
        draw = robot_scenario if self.robot else self.kind.draw
        drawn = draw(settings, self.seed, number, self.most_obstacles)
        if self.kind.lag is not None:
            lag = float(np.random.default_rng([drawn.seed, number]).uniform(*self.kind.lag))
            plant = replace(plant, wheel_lag=lag)
        known, changes = drawn.obstacles, drawn.changes
        foreign = None
        if self.kind.is_foreign:
            foreign = ForeignRobot.draw(self.seed, number)
            changes = {**changes, 'command_delay': foreign.told}
            plant = replace(plant, wheel_lag=foreign.lag)
        if self.kind.sees:
            known = ()
        elif self.kind.has_map:
            truth = replace(settings, obstacles=known, **changes)
            time = shortest_length(truth, np.array(drawn.pose)) / (_PACE * settings.pace)
            periods = math.ceil(time / settings.control_period)
            changes = {**changes, 'final_time': periods * settings.control_period}
            known = (map_of(drawn.obstacles),)
        return RunTask(
            drawn,
            replace(settings, obstacles=known, **changes),
            replace(plant, initial_pose=drawn.pose, seed=drawn.seed),
            self.kind.lateness,
            replace(_scanner(self), seed=drawn.seed) if self.kind.sees else None,
            has_map=self.kind.has_map,
            foreign=foreign,
        )

    def command(self, number: int) -> str:
        """The command that makes one run again."""
        words: Sequence[str] = (
            f'cmpsp study {self.name} --seed {self.seed} --run {number}',
            *([f'--robot {self.robot}'] * bool(self.robot)),
            *([f'--obstacles {self.most_obstacles}'] * (self.most_obstacles != MOST_OBSTACLES)),
            *(f'--set {each}' for each in self.assignments),
        )
        return ' '.join(words)


@dataclass(frozen=True)
class RunTask:
    """Everything that one run depends on.

    Attributes:
        scenario: Start and obstacles.
        settings: Settings of the guidance law.
        plant: Settings of the simulated robot.
        foreign: The robot that is driven instead, if any.
        lateness: Maximum duration of a control step, in control periods.
        scanner: Scanner of a robot that knows obstacles only by sight.
        patience: Time after which a run with repeatedly postponed goals ends [s].
        has_map: Same as in `StudyKind`.
    """

    scenario: Scenario
    settings: GuidanceSettings
    plant: PlantSettings
    lateness: float = 0.0
    scanner: LaserSettings | None = None
    patience: float = 180.0
    has_map: bool = False
    foreign: ForeignRobot | None = None

    @property
    def truth(self) -> GuidanceSettings:
        """The settings with all obstacles, those that are not known too."""
        return replace(self.settings, obstacles=self.scenario.obstacles)

    def eyes(self) -> Eyes | None:
        """Simulated sensors of the robot, if any."""
        if self.scanner is None:
            return None
        return Eyes(self.settings, self.scanner, self.scenario.obstacles)


@cache
def _setup(study: Study) -> tuple[GuidanceSettings, PlantSettings]:
    """Settings shared by all runs of a study; reading them takes as long as a run."""
    values = study.values()
    return guidance_settings(values), plant_settings(values)


@cache
def _scanner(study: Study) -> LaserSettings:
    return laser_settings(study.values())
