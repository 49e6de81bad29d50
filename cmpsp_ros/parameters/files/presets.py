"""Parameter files: presets and robots that come with the package, and the user's own."""

import difflib
import os
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from cmpsp_ros.parameters.errors import ParameterError, Problem, describe
from cmpsp_ros.parameters.files import ros_yaml
from cmpsp_ros.parameters.files.course_files import with_map_file, with_road_file

_PACKAGE: Final = 'cmpsp_ros'
_OURS: Final = ('guidance', 'sim')
_DEFAULTS: Final = 'defaults'
_SECTION_OF_ROBOT: Final = re.compile(rf'/?((?:/\w+)+)/(?:\*\*?|{"|".join(_OURS)})')
_KEYS_OF_ROBOT: Final = ('robot.', 'initial_guess.')
_ALSO_OF_ROBOT: Final = ('command_delay', 'max_wheel_lag', 'enable_stamped_cmd_vel')


def config_directory(here: Path = Path(__file__)) -> Path:
    """Folder of the presets above a module; ParameterError if it was not installed."""
    # The second path matters in a workspace of symbolic links, the first where only they lead on.
    for folder in [*here.absolute().parents, *here.resolve().parents]:
        in_source = folder / 'config'
        if (folder / 'package.xml').is_file() and in_source.is_dir():
            return in_source
        installed = folder / 'share' / _PACKAGE / 'config'
        if installed.is_dir():
            return installed
    wanted = f'config/ beside package.xml, or share/{_PACKAGE}/config/ of the installation'
    raise ParameterError(Problem(str(here.parent), 'no folder of presets above', wanted))


def preset_names() -> list[str]:
    """Names of the presets, sorted."""
    return _names(config_directory())


def robot_names() -> list[str]:
    """Names of the robots, sorted."""
    return _names(config_directory() / 'robots')


def robots_in(path_or_preset_name: str | os.PathLike[str]) -> tuple[str, ...]:
    """Namespaces for which a parameter file or preset has sections of their own, in its order."""
    found = map(_SECTION_OF_ROBOT.fullmatch, _sections(_path(path_or_preset_name)))
    return tuple(dict.fromkeys(each[1] for each in found if each is not None))


def load_parameter_file(
    path_or_preset_name: str | os.PathLike[str],
    node: str | None = None,
    *,
    namespace: str | None = None,
) -> dict[str, Any]:
    """The values of a parameter file, or of a preset by its name, flat and not checked.

    They are those of a `node` such as ``/r1/guidance``, or of guidance and simulator in a
    `namespace`, else in any; the later section counts. ParameterError if there is no such file, no
    ROS parameters in it, or different values for several nodes or robots and none is selected.
    """
    path = _path(path_or_preset_name)
    sections = _sections(path)
    nodes = [node] if node else [f'{namespace}/{each}' for each in _OURS] if namespace else []
    chosen = {name: s for name, s in sections.items() if _concerns(name, nodes)}
    if not chosen:
        found = f'sections for {", ".join(sections)} only'
        wanted = f'one for {" or ".join(nodes) or "/**, guidance, sim"}'
        raise ParameterError(Problem(str(path), found, wanted))
    if node is None:
        _refuse_contradictions(chosen, str(path), namespace)
    values = {key: value for section in chosen.values() for key, value in section.items()}
    return with_files(values, path.parent)


def load_robot(path_or_name: str) -> dict[str, Any]:
    """The values of a robot's file; ParameterError if it has parameters of a course."""
    path = _file_of(path_or_name, 'robot', config_directory() / 'robots')
    given = load_parameter_file(path)
    strange = [
        key for key in given if not key.startswith(_KEYS_OF_ROBOT) and key not in _ALSO_OF_ROBOT
    ]
    if strange:
        wanted = f'only {", ".join([*(f"{each}*" for each in _KEYS_OF_ROBOT), *_ALSO_OF_ROBOT])}'
        found = f'{", ".join(strange)} in the file of a robot'
        raise ParameterError(Problem(str(path), found, wanted))
    return given


def with_files(values: Mapping[str, Any], folder: Path | None = None) -> dict[str, Any]:
    """Replace names of road and map files, relative to the folder, by their contents."""
    return with_map_file(with_road_file(values), folder)


def parse_assignment(text: str) -> tuple[str, Any]:
    """Key and value of ``weights.road_center=30``, the value in YAML, or ParameterError."""
    key, equals, value = text.partition('=')
    key = key.strip()
    if not equals or not key:
        raise ParameterError(Problem(describe(text), 'no key=value', 'such as final_time=12.0'))
    return key, ros_yaml.read_value(value.strip(), key)


def write_parameter_file(path: str | os.PathLike[str], values: Mapping[str, Any]) -> None:
    """Write a parameter file as `write_fleet_file`, for all nodes in any namespace."""
    write_fleet_file(path, {'': values})


def write_fleet_file(path: str | os.PathLike[str], robots: Mapping[str, Mapping[str, Any]]) -> None:
    """Write plain values by key with a section for each namespace; ROS reads them bit for bit."""
    text = '\n'.join(ros_yaml.dump(values, name) for name, values in robots.items())
    try:
        Path(path).write_text(text, encoding='utf-8')
    except OSError as error:
        problem = Problem(str(path), str(error.strerror), 'a place to write parameters to')
        raise ParameterError(problem) from error


def _path(path_or_preset_name: str | os.PathLike[str]) -> Path:
    if not isinstance(path_or_preset_name, str):
        return Path(path_or_preset_name)
    return _file_of(path_or_preset_name, 'preset', config_directory())


def _names(folder: Path) -> list[str]:
    return sorted(each.stem for each in folder.glob('*.yaml') if each.stem != _DEFAULTS)


def _file_of(path_or_name: str, kind: str, folder: Path) -> Path:
    """The file that is meant by a path, or by a name without folder and suffix."""
    path = Path(path_or_name)
    if path.suffix or path.name != path_or_name:
        return path
    names = _names(folder)
    if path.name in names:
        return folder / f'{path.name}.yaml'
    nearest = difflib.get_close_matches(path.name, names, n=1)
    hint = f' (did you mean {nearest[0]}?)' if nearest else ''
    wanted = f'a {kind} ({", ".join(names)}) or a file, as in ./{path.name}.yaml{hint}'
    raise ParameterError(Problem(describe(path_or_name), f'no such {kind}', wanted))


def _sections(path: Path) -> ros_yaml.Sections:
    try:
        text = path.read_text(encoding='utf-8')
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        wanted = f'a file of parameters, or one of the presets {", ".join(preset_names())}'
        raise ParameterError(Problem(str(path), str(reason), wanted)) from error
    return ros_yaml.read_sections(text, str(path))


def _concerns(section: str, nodes: Sequence[str]) -> bool:
    """True if a section is for one of these nodes; for any of our nodes if none is given."""
    if not nodes:
        last = section.rpartition('/')[2]
        return last in {'*', '**', *_OURS}
    pattern = re.escape(section).replace(r'/\*\*', r'(/\w+)*').replace(r'/\*', r'/\w+')
    return any(re.fullmatch(pattern, f'/{each.lstrip("/")}') for each in nodes)


def _refuse_contradictions(sections: ros_yaml.Sections, source: str, namespace: str | None) -> None:
    said: dict[str, tuple[str, Any]] = {}
    problems = []
    robots = {each.rpartition('/')[0].strip('/*') for each in sections} - {''}
    is_of_one = bool(namespace) or len(robots) < 2
    for name, section in sections.items():
        # One for all nodes contradicts none, that for all nodes of a robot none of the same robot.
        if name.endswith('*') and (is_of_one or not name.strip('/*')):
            continue
        for key, value in section.items():
            other, before = said.setdefault(key, (name, value))
            if before != value:
                found = f'{describe(before)} for {other} and {describe(value)} for {name}'
                hint = '' if is_of_one else ', or the namespace of a robot'
                problems.append(Problem(f'{source}: {key}', found, f'one value for both{hint}'))
    if problems:
        raise ParameterError(*problems)
