"""Data kept with a bag beside its messages: parameters and software versions."""

import json
import platform
from array import array
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from cmpsp_ros.bags.definitions import jazzy

# Key in the bag's custom data: JSON text `{node: {parameter: value}}`.
PARAMETERS_KEY = 'cmpsp_ros.parameters'
# Key in the bag's custom data: version of this package that wrote the bag.
VERSION_KEY = 'cmpsp_ros.version'
SOFTWARE_KEY = 'cmpsp_ros.software'  # key in the bag's custom data: JSON text `{name: version}`

# Versions that determine the last bits of a decision, and the writer of the file.
_PACKAGES = ('numpy', 'scipy', 'numba', 'llvmlite', 'clarabel', 'rosbags', 'rclpy')


def plain_values(parameters: Iterable[Any]) -> dict[str, Any]:
    """Values by name from messages `rcl_interfaces/msg/Parameter`; None if not set."""
    values = {}
    # By its type, from 1; before them, its type.
    _, fields = jazzy().fielddefs['rcl_interfaces/msg/ParameterValue']
    for each in parameters:
        kind = each.value.type
        found = getattr(each.value, fields[kind][0]) if 1 <= kind < len(fields) else None
        values[each.name] = found.tolist() if isinstance(found, np.ndarray) else found
    return values


def own_version() -> str:
    """Version of this package."""
    return _version('cmpsp_ros')


def software_versions() -> dict[str, str]:
    """Versions of the software installed here, by name; `unknown` if it is not installed."""
    return {
        'python': platform.python_version(),
        'machine': f'{platform.machine()}, {platform.system()} {platform.release()}',
        **{name: _version(name) for name in _PACKAGES},
    }


def plain(value: object) -> object:
    """Convert a parameter's value to JSON types, or raise a `TypeError`."""
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    if isinstance(value, (Sequence, array)):
        return [plain(each) for each in value]
    raise TypeError(f'is a {type(value).__name__}, which a bag cannot keep')


def parsed(custom: Mapping[str, Any], key: str) -> dict[str, Any]:
    """Read a JSON mapping in custom data; raises TypeError, ValueError or RecursionError."""
    found = json.loads(expected(custom.get(key, '{}'), str, key))
    mapping: dict[str, Any] = expected(found, dict, key)
    if key == PARAMETERS_KEY:
        for node, values in mapping.items():
            expected(values, dict, f'parameters of {node}')
    return mapping


def expected(value: Any, kind: type, what: str) -> Any:
    """Check the type of a value from a bag, and return it; raises `TypeError` otherwise."""
    if not isinstance(value, kind):
        raise TypeError(f'{what} is a {type(value).__name__}, wanted a {kind.__name__}')
    return value


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return 'unknown'
