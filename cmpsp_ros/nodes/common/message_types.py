"""Message classes by their type names in bags."""

from __future__ import annotations

import re
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from cmpsp_ros.bags import UnknownTypeError

_NAME = re.compile(r'([a-z][a-z0-9_]*)/msg/([A-Z][A-Za-z0-9]*)')


def message_class(name: str) -> Any:
    """Class of a type, such as `nav_msgs/msg/Odometry`; raises UnknownTypeError without it."""
    match = _NAME.fullmatch(name)
    # A bag may name any package; only one of messages is imported.
    if match and _has_messages(match[1]):
        found = getattr(import_module(f'{match[1]}.msg'), match[2], None)
        if found is not None:
            return found
    raise UnknownTypeError(f'found type {name!r}, wanted one that is installed here')


def _has_messages(package: str) -> bool:
    spec = find_spec(package)
    folders = (spec and spec.submodule_search_locations) or ()
    return any((Path(folder) / 'msg' / '__init__.py').is_file() for folder in folders)
