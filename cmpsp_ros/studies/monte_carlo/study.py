"""The named studies, and the settings of each of their runs."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from cmpsp_ros.guidance.settings import GuidanceSettings, SolverSettings
from cmpsp_ros.parameters.catalogue import TABLE
from cmpsp_ros.parameters.presets import load_parameter_file, parse_assignment
from cmpsp_ros.parameters.settings import guidance_settings, plant_settings
from cmpsp_ros.simulator.plant import PlantSettings
from cmpsp_ros.studies.errors import StudyError
from cmpsp_ros.studies.monte_carlo.random_courses import corridor_scenario, floor_scenario
from cmpsp_ros.studies.monte_carlo.scenario import FROM_EDGE, GAP, Scenario, scenario

PRESET: Final = 'case3'
MOST_OBSTACLES: Final = 4

# The paper's first guess is made for the paper's start, and fewer iterations go with it.
_ALWAYS: Final = {
    'initial_guess.type': 'road',
    'obstacles.names': [],
    'solver.initial_iterations': SolverSettings().initial_iterations,
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
    """

    changes: Mapping[str, Any]
    tolerance: float
    draw: Callable[[GuidanceSettings, int, int, int], Scenario] = scenario
    lateness: float = 0.0
    lag: tuple[float, float] | None = None

    @property
    def has_own_roads(self) -> bool:
        """Whether each run has another road."""
        return self.draw is not scenario


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
            {
                'robot.max_wheel_acceleration': 60.0,
                'max_wheel_lag': 0.3,
                'safety.margin': 0.05,
            },
            0.05,
            lag=(0.1, 0.3),
        ),
        'corridors': Kind(_WITH_A_BODY, 1e-3, corridor_scenario),
        'floor': Kind(_WITH_A_BODY, 1e-3, floor_scenario),
    }
)


@dataclass(frozen=True)
class Study:
    """A study: every run of it depends only on this value and the run's number.

    Attributes:
        name: Of its kind.
        seed: Of all its scenarios.
        most_obstacles: Maximum number on the road in one run.
        assignments: Further parameters, each as `key=value`.
    """

    name: str
    seed: int = 1
    most_obstacles: int = MOST_OBSTACLES
    assignments: tuple[str, ...] = ()

    @property
    def tolerance(self) -> float:
        """Miss up to which a run has arrived [m]."""
        return self.kind.tolerance

    @property
    def kind(self) -> Kind:
        """What makes it differ from other studies."""
        return KINDS[self.name]

    def values(self) -> dict[str, Any]:
        """All parameters, without obstacles.

        Raises:
            StudyError: There is no study of that name, or there is no room on its road.
            ParameterError: An assignment is wrong.
        """
        if self.name not in KINDS:
            raise StudyError(f'study: found {self.name!r}, wanted one of {", ".join(KINDS)}')
        given = load_parameter_file(PRESET)
        for name in given['obstacles.names']:
            given = {k: v for k, v in given.items() if not k.startswith(f'obstacles.{name}.')}
        given |= {**_ALWAYS, **self.kind.changes}
        given.update(parse_assignment(each) for each in self.assignments)
        values = TABLE.resolve(given)
        settings = guidance_settings(values)
        plant_settings(values)
        if values['road.type'] != 'annulus':
            raise StudyError(f'road.type: found {values["road.type"]}, wanted annulus')
        width = settings.road.width
        needed = max(GAP, 2.0 * FROM_EDGE) + 2.0 * settings.robot_radius
        if width <= needed:
            raise StudyError(f'road: found {width:g} m of width, wanted more than {needed:g} m')
        if settings.obstacles:
            raise StudyError('obstacles.names: found obstacles, wanted none: they are drawn')
        return dict(values)

    def setup(self) -> tuple[GuidanceSettings, PlantSettings]:
        """Settings of law and plant in every run, but for start, obstacles and seed."""
        return _setup(self)

    def run(self, number: int) -> Task:
        """What the run of that number is."""
        settings, plant = self.setup()
        drawn = self.kind.draw(settings, self.seed, number, self.most_obstacles)
        if self.kind.lag is not None:
            lag = float(np.random.default_rng([drawn.seed, number]).uniform(*self.kind.lag))
            plant = replace(plant, wheel_lag=lag)
        return Task(
            drawn,
            replace(settings, obstacles=drawn.obstacles, **drawn.changes),
            replace(plant, initial_pose=drawn.pose, seed=drawn.seed),
            self.kind.lateness,
        )

    def command(self, number: int) -> str:
        """The command that makes one run again."""
        words: Sequence[str] = (
            f'cmpsp study {self.name} --seed {self.seed} --run {number}',
            *([f'--obstacles {self.most_obstacles}'] * (self.most_obstacles != MOST_OBSTACLES)),
            *(f'--set {each}' for each in self.assignments),
        )
        return ' '.join(words)


@dataclass(frozen=True)
class Task:
    """Everything that one run depends on.

    Attributes:
        scenario: Start and obstacles.
        settings: Of the guidance law.
        plant: Of the simulated robot.
        lateness: Longest time that a control step takes, in control periods.
    """

    scenario: Scenario
    settings: GuidanceSettings
    plant: PlantSettings
    lateness: float = 0.0


@cache
def _setup(study: Study) -> tuple[GuidanceSettings, PlantSettings]:
    """What all runs of a study have in common; to read it takes as long as a run."""
    values = study.values()
    return guidance_settings(values), plant_settings(values)
