"""The scenario of a demo, of one robot or several, checked before anything starts."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Any, Final

import numpy as np

from cmpsp_ros.guidance import GuidanceSettings
from cmpsp_ros.guidance.mission import infeasibility_warnings, shortest_time
from cmpsp_ros.parameters import (
    TABLE,
    ParameterError,
    Problem,
    Values,
    check_simulation,
    guidance_settings,
    load_parameter_file,
    plausibility_warnings,
    shapes_of,
)
from cmpsp_ros.parameters.files import load_robot, parse_assignment, with_files
from cmpsp_ros.robots import placed
from cmpsp_ros.world.obstacles import Shape

# Part of its top speed at which a robot that was chosen goes the shortest way; as in case 3.
_PACE: Final = 0.8


@dataclass(frozen=True)
class Scenario:
    """A complete, checked set of parameters of all nodes, with remarks for the user on it.

    Its name is a preset, or a file without its suffix, and the robot if one was chosen; a single
    robot has no namespace.
    """

    name: str
    values: Values
    settings: GuidanceSettings
    remarks: tuple[str, ...] = ()
    namespace: str = ''

    @property
    def lockstep(self) -> bool:
        """True if the simulator waits for the answer to its odometry."""
        return bool(self.values['lockstep'])

    @property
    def hidden(self) -> tuple[Shape, ...]:
        """Obstacles that only the simulator knows."""
        return shapes_of(self.values)

    @property
    def truth(self) -> GuidanceSettings:
        """The settings with all static obstacles, also those unknown to guidance."""
        return replace(self.settings, obstacles=self.settings.obstacles + self.hidden)

    @property
    def duration(self) -> float:
        """Wall time of the run [s]; in lockstep it is shorter."""
        return float(self.settings.final_time / self.values['real_time_factor'])


def load_scenario(
    preset: str,
    assignments: Sequence[str],
    *,
    lockstep: bool,
    robot: str | None = None,
    namespace: str = '',
) -> Scenario:
    """Read a preset or parameter file, change it by `key=value`, and check the whole.

    A robot, by name or file, is applied on top of the preset; a final time too short for it is
    increased unless assigned. Raises ParameterError.
    """
    changes = dict(parse_assignment(each) for each in assignments)
    given = load_parameter_file(preset, namespace=namespace or None)
    given = with_files(given | (load_robot(robot) if robot else {}) | changes)
    # The nodes are activated when the recorder listens, and not before.
    given['autostart'] = False
    if lockstep:
        given['lockstep'] = True
    if given.get('lockstep') or given.get('real_time_factor', 1.0) != 1.0:
        # Time then passes otherwise than by the clocks of the nodes, and all must know.
        given['publish_clock'] = True
    name, remarks = Path(preset).stem, []
    if robot:
        name = f'{name} with {Path(robot).stem}'
        if 'final_time' not in changes:
            remarks += _give_time(given)
    values = TABLE.resolve(given)
    settings = guidance_settings(values)
    if not math.isfinite(settings.final_time):
        raise ParameterError(Problem('final_time', '0.0 s', 'when to stop: a demo comes to an end'))
    check_simulation(values)
    remarks += [
        *plausibility_warnings(values),
        *infeasibility_warnings(settings, settings.world, _start(values)),
    ]
    return Scenario(name, values, settings, tuple(remarks), namespace)


def load_fleet(
    preset: str,
    namespaces: Sequence[str],
    assignments: Sequence[str],
    *,
    lockstep: bool = False,
    robot: str | None = None,
) -> tuple[Scenario, ...]:
    """Load the scenario of each robot in a file, as from `load_scenario`, and check the whole.

    Raises ParameterError also where robots start too close to each other, or want simulated
    time.
    """
    fleet = tuple(
        load_scenario(preset, assignments, lockstep=lockstep, robot=robot, namespace=each)
        for each in namespaces
    )
    problems = [
        Problem(f'{each.namespace}: {key}', 'true', 'false: several simulators share no clock')
        for each in fleet
        for key in ('lockstep', 'publish_clock')
        if each.values[key]
    ]
    for one, other in combinations(fleet, 2):
        (x, y), pose = other.values['initial_pose'][:2], np.array(one.values['initial_pose'])
        discs = placed(one.settings.footprint.discs, pose)
        away = float(np.hypot(*(discs - (x, y)).T).min())
        least = one.settings.robot_radius + other.settings.circumscribed_radius
        if away < least:
            found, wanted = f'{away:.3g} m from {other.namespace}', f'{least:.3g} m or more'
            problems.append(Problem(f'{one.namespace}: initial_pose', found, wanted))
    if problems:
        raise ParameterError(*problems)
    return fleet


def _give_time(given: dict[str, Any]) -> list[str]:
    """Make the final time longer if the robot needs more; says so."""
    values = TABLE.resolve(given)
    settings = guidance_settings(values)
    # In whole seconds, which are a whole number of most control periods.
    needed = float(math.ceil(shortest_time(settings, settings.road, _start(values)) / _PACE))
    if needed <= settings.final_time:
        return []
    given['final_time'] = needed
    return [
        f'final_time is {needed:g} s instead of {settings.final_time:g} s:'
        f' this robot drives at most {settings.robot.max_speed:.3g} m/s.'
    ]


def _start(values: Values) -> tuple[float, float]:
    x, y, _ = values['initial_pose']
    return x, y
