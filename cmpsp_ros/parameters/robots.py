"""Robots that people own: parameter files to be laid over a course."""

from __future__ import annotations

from typing import Any, Final

from cmpsp_ros.parameters.errors import ParameterError, Problem
from cmpsp_ros.parameters.presets import config_directory, file_of, load_parameter_file

_OF_ROBOTS: Final = ('robot.', 'initial_guess.')
_ALSO: Final = ('command_delay', 'enable_stamped_cmd_vel')


def robot_names() -> list[str]:
    """Names of the robots, sorted.

    Raises:
        ParameterError: If the package was installed without them.
    """
    return sorted(path.stem for path in (config_directory() / 'robots').glob('*.yaml'))


def load_robot(path_or_name: str) -> dict[str, Any]:
    """What the file of a robot says, before any check of its values.

    Args:
        path_or_name: A file; or, without folder and suffix, one of `robot_names`.

    Returns:
        Values by key.

    Raises:
        ParameterError: If there is no such robot or file, it is not YAML of ROS parameters, or
            says what belongs to a course.
    """
    path = file_of(path_or_name, 'robot', config_directory() / 'robots')
    given = load_parameter_file(path)
    strange = [key for key in given if not key.startswith(_OF_ROBOTS) and key not in _ALSO]
    if strange:
        wanted = f'only {", ".join([*(f"{each}*" for each in _OF_ROBOTS), *_ALSO])}'
        found = f'{", ".join(strange)} in the file of a robot'
        raise ParameterError(Problem(str(path), found, wanted))
    return given
