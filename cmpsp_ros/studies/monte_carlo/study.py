"""The named studies, and the settings of each of their runs."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
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
from cmpsp_ros.simulator import LaserSettings, People, PlantSettings, discs_of, edges_of
from cmpsp_ros.studies.common import UsageError
from cmpsp_ros.studies.monte_carlo.contacts import Crowd
from cmpsp_ros.studies.monte_carlo.courses.crowds import SCENES, crowd_scenario
from cmpsp_ros.studies.monte_carlo.courses.ring_courses import (
    FROM_EDGE,
    GAP,
    WIDTH,
    Scenario,
    in_proportion,
    robot_scenario,
)
from cmpsp_ros.studies.monte_carlo.eyes import Eyes, map_of
from cmpsp_ros.studies.monte_carlo.foreign_robot import ForeignRobot
from cmpsp_ros.studies.monte_carlo.guesses import shortest_length
from cmpsp_ros.studies.monte_carlo.kinds import KINDS, NOISY, OWN, ROBOTS, StudyKind

MOST_OBSTACLES: Final = 4

_NOISY_TURN: Final = 4  # turns through all scenes and robots, of which the last has noise
# Parameters of presets that every run draws for itself.
_CHOSEN_AMONG_PEOPLE: Final = 'sim.people.', 'goal.position', 'final_time', 'initial_pose'
_DRAWN: Final = ('obstacles.', 'sim.obstacles.', 'road.points', 'road.half_width')
# Time [s], and multiple of that for the straight way, after which a run among people ends.
_PATIENCE: Final = 90.0, 6.0
# Mean speed that is asked for with a map, along the shortest path, of the nominal one.
_PACE: Final = 0.95

# The paper's first guess is made for the paper's start, and fewer iterations go with it.
_ALWAYS: Final = {
    'initial_guess.type': 'road',
    'solver.initial_iterations': SolverSettings().initial_iterations,
}


@dataclass(frozen=True)
class Study:
    """A study: every run of it depends only on this value and the run's number."""

    name: str  # of its kind
    seed: int = 1  # of all its scenarios
    most_obstacles: int = MOST_OBSTACLES  # maximum number on the road in one run
    assignments: tuple[str, ...] = ()  # further parameters, each as `key=value`
    robot: str = ''  # name or file of a robot, for which the courses are made then
    scene: str = ''  # name of the scene of all runs with people; empty for all scenes in turn
    told: bool = False  # true if people are known exactly instead of seen
    seen: bool = False  # true if the comparison runs of study people are skipped

    @property
    def tolerance(self) -> float:
        """Miss up to which a run has arrived [m]."""
        return self.kind.tolerance

    @property
    def kind(self) -> StudyKind:
        """Kind of the study, by name."""
        return KINDS[self.name]

    def values(self) -> dict[str, Any]:
        """All parameters, without obstacles; raises UsageError or ParameterError."""
        if self.name not in KINDS:
            raise UsageError(f'study: found {self.name!r}, wanted one of {", ".join(KINDS)}')
        given = load_parameter_file(self.kind.preset)
        given = {key: value for key, value in given.items() if not key.startswith(_DRAWN)}
        given |= {**_ALWAYS, **self.kind.changes}
        if not self.kind.has_people and (self.scene or self.told or self.seen):
            raise UsageError(f'--scene, --told, --seen: found study {self.name}, wanted people')
        if self.told and self.seen:
            raise UsageError('--told, --seen: found both, wanted one of them')
        if self.scene and self.scene not in SCENES:
            raise UsageError(f'--scene: found {self.scene!r}, wanted one of {", ".join(SCENES)}')
        assigned = dict(parse_assignment(each) for each in self.assignments)
        if self.kind.has_people:
            for key in assigned:
                if key.startswith(_CHOSEN_AMONG_PEOPLE):
                    raise UsageError(f'{key}: found in --set, wanted none: the study chooses it')
            own = {} if self.robot in {'', OWN} else load_robot(self.robot)
            given |= {**own, **ROBOTS.get(self.robot, {}), **_ALWAYS}
        elif self.robot:
            given |= self._fitted(given, assigned)
        values = TABLE.resolve(given | assigned)
        settings = guidance_settings(values)
        plant_settings(values)
        wanted = 'none' if self.kind.sees or self.kind.has_map else 'annulus'
        if values['road.type'] != wanted:
            raise UsageError(f'road.type: found {values["road.type"]}, wanted {wanted}')
        width = settings.road.width
        scale = width / WIDTH
        needed = scale * max(GAP, 2.0 * FROM_EDGE) + 2.0 * settings.robot_radius
        if width <= needed and wanted == 'annulus':
            raise UsageError(f'road: found {width:g} m of width, wanted more than {needed:g} m')
        if width <= needed:
            most = settings.robot_radius - (needed - width) / 2.0
            found = f'found {settings.robot_radius:g} m, wanted less than {most:g} m'
            raise UsageError(f'robot.radius: {found}')
        if settings.obstacles:
            raise UsageError('obstacles.names: found obstacles, wanted none: they are drawn')
        return dict(values)

    def _fitted(self, given: Mapping[str, Any], assigned: Mapping[str, Any]) -> dict[str, Any]:
        if self.kind is not KINDS['nominal']:
            raise UsageError(f'--robot: found study {self.name}, wanted nominal: it has its own')
        changes = load_robot(self.robot) | _ALWAYS
        values = TABLE.resolve({**given, **changes, **assigned})
        robot = plant_settings(values).robot
        if not math.isfinite(robot.max_speed):
            raise UsageError('robot.max_wheel_speed: found 0.0, wanted a limit for --robot')
        return changes | in_proportion(robot, given, values['robot.radius'])

    def setup(self) -> tuple[GuidanceSettings, PlantSettings]:
        """Settings of law and plant in every run, but for start, obstacles and seed."""
        return _setup(self)[:2]

    def run(self, number: int) -> RunTask:
        """Task of the run of that number."""
        if self.kind.has_people:
            return self._run_among_people(number)
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
        return self._task(drawn, replace(settings, obstacles=known, **changes), plant, foreign)

    def _task(
        self,
        drawn: Scenario,
        settings: GuidanceSettings,
        plant: PlantSettings,
        foreign: ForeignRobot | None = None,
    ) -> RunTask:
        laser = _setup(self)[2]
        scanner = None if laser is None else replace(laser, seed=drawn.seed)
        plant = replace(plant, initial_pose=drawn.pose, seed=drawn.seed)
        return RunTask(drawn, settings, plant, self.kind, scanner, foreign)

    def _run_among_people(self, number: int) -> RunTask:
        """Task of a run with people: scenes and robots in turn, every fourth turn with noise."""
        scenes = [self.scene] if self.scene else [*SCENES]
        robots = [self.robot] if self.robot else [*ROBOTS]
        turn, scene = divmod(number, len(scenes))
        turn, robot = divmod(turn, len(robots))
        noise = NOISY if turn % _NOISY_TURN == _NOISY_TURN - 1 else {}
        assigned = (*(f'{key}={value}' for key, value in noise.items()), *self.assignments)
        study = replace(self, robot=robots[robot], assignments=assigned)
        settings, plant = study.setup()
        drawn = crowd_scenario(settings, self.seed, number, scenes[scene])
        straight = math.dist(drawn.pose[:2], drawn.changes['goal']) / settings.pace
        patience = _PATIENCE[0] + _PATIENCE[1] * straight
        crowd = Crowd(scenes[scene], robots[robot], bool(noise), self.told)
        task = study._task(drawn, replace(settings, **drawn.changes), plant)  # noqa: SLF001 (own)
        return replace(task, patience=patience, crowd=crowd)

    def command(self, number: int) -> str:
        """The command that makes one run again."""
        words: Sequence[str] = (
            f'cmpsp study {self.name} --seed {self.seed} --run {number}',
            *([f'--robot {shlex.quote(self.robot)}'] * bool(self.robot)),
            *([f'--scene {self.scene}'] * bool(self.scene)),
            *(['--told'] * self.told),
            *(['--seen'] * self.seen),
            *([f'--obstacles {self.most_obstacles}'] * (self.most_obstacles != MOST_OBSTACLES)),
            *(f'--set {shlex.quote(each)}' for each in self.assignments),
        )
        return ' '.join(words)


@dataclass(frozen=True)
class RunTask:
    """Everything that one run depends on."""

    scenario: Scenario  # start and obstacles
    settings: GuidanceSettings  # of the guidance law
    plant: PlantSettings  # settings of the simulated robot
    kind: StudyKind
    scanner: LaserSettings | None = None  # of a robot that knows obstacles only by sight
    foreign: ForeignRobot | None = None  # the robot that is driven instead, if any
    patience: float = 180.0  # time after which a run with repeatedly postponed goals ends [s]
    crowd: Crowd | None = None  # circumstances of a run among people; None without

    @property
    def truth(self) -> GuidanceSettings:
        """The settings with all obstacles, those that are not known too."""
        return replace(self.settings, obstacles=self.scenario.obstacles)

    def people(self) -> People | None:
        """Those who walk about, at the beginning of the run; None without."""
        if self.scenario.people is None:
            return None
        shapes = self.scenario.obstacles
        return People(self.scenario.people, edges_of(shapes), discs_of(shapes))

    def eyes(self, people: People | None) -> Eyes | None:
        """Simulated sensors of the robot, if any; people who are told are not seen."""
        if self.scanner is None:
            return None
        seen = None if self.crowd is not None and self.crowd.told else people
        return Eyes(self.settings, self.scanner, self.scenario.obstacles, seen)


@cache
def _setup(study: Study) -> tuple[GuidanceSettings, PlantSettings, LaserSettings | None]:
    """Settings shared by all runs of a study; reading them takes as long as a run."""
    values = study.values()
    laser = laser_settings(values) if study.kind.sees else None
    return guidance_settings(values), plant_settings(values), laser
