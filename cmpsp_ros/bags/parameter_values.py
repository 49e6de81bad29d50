"""Conversion of parameter values to and from messages."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

_FIELDS = (
    'bool_value',
    'integer_value',
    'double_value',
    'string_value',
    'byte_array_value',
    'bool_array_value',
    'integer_array_value',
    'double_array_value',
    'string_array_value',
)
"""Fields of `rcl_interfaces/msg/ParameterValue` by its type, from 1."""


def plain_values(parameters: Iterable[Any]) -> dict[str, Any]:
    """Values by name from messages `rcl_interfaces/msg/Parameter`; None if not set."""
    return {each.name: _plain(each.value) for each in parameters}


def _plain(value: Any) -> Any:
    if not 1 <= value.type <= len(_FIELDS):
        return None
    found = getattr(value, _FIELDS[value.type - 1])
    return found.tolist() if isinstance(found, np.ndarray) else found
