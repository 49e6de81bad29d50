"""The parameter table: reads a whole set at once, and reports all its problems."""

import difflib
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, Final

from cmpsp_ros.parameters.errors import ParameterError, Problem, Problems, describe
from cmpsp_ros.parameters.parameter import Parameter

Values = dict[str, Any]  # a complete set by key, each value of its parameter's type

_NAME: Final = re.compile(r'[A-Za-z][A-Za-z0-9_]*')
_OF_ROS: Final = re.compile(r'use_sim_time|start_type_description_service|qos_overrides\..*')


def is_of_ros(key: object) -> bool:
    """True if ROS itself declares this parameter on every node."""
    return isinstance(key, str) and _OF_ROS.fullmatch(key) is not None


class ParameterTable:
    """Parameters in the order of the documentation.

    ``obstacles.<name>.radius`` stands for one for each name in ``obstacles.names``.
    """

    def __init__(self, parameters: Iterable[Parameter]) -> None:
        self._parameters = tuple(parameters)
        self._single = {p.name: p for p in self._parameters if not p.is_block}
        self._blocks: dict[str, list[Parameter]] = {}
        for parameter in self._parameters:
            if parameter.is_block:
                self._blocks.setdefault(parameter.prefix, []).append(parameter)

    def __iter__(self) -> Iterator[Parameter]:
        """The parameters, those with ``<name>`` once."""
        return iter(self._parameters)

    def find(self, key: str) -> Parameter | None:
        """The parameter with this key; None when the table has none."""
        if key in self._single:
            return self._single[key]
        for prefix, block in self._blocks.items():
            name = key.removeprefix(prefix).partition('.')[0]
            for parameter in block:
                if _NAME.fullmatch(name) and parameter.key(name) == key:
                    return parameter
        return None

    def keys(self, names: Mapping[str, Sequence[str]]) -> list[tuple[str, Parameter]]:
        """Every key with its parameter, in order, for the names listed in a resolved set."""
        keys = []
        for parameter in self._parameters:
            if not parameter.is_block:
                keys.append((parameter.name, parameter))
            elif parameter is self._blocks[parameter.prefix][0]:
                block = self._blocks[parameter.prefix]
                listed = names.get(_names_key(parameter.prefix), ())
                keys += [(member.key(name), member) for name in listed for member in block]
        return keys

    def resolve(self, values: Mapping[str, object]) -> Values:
        """The complete set in the table's order: values of YAML, Python or rclpy, and defaults.

        ParameterError with all problems; parameters of ROS itself are ignored.
        """
        given = {key: value for key, value in values.items() if not is_of_ros(key)}
        problems = Problems()
        resolved: Values = {}

        def take(key: str, parameter: Parameter) -> None:
            default = partial(parameter.read_default, key)
            read = partial(parameter.read, key, given.pop(key)) if key in given else default
            if (value := problems.attempt(read)) is not None:
                resolved[key] = value

        for key, parameter in self._single.items():
            take(key, parameter)
        for prefix in self._blocks:
            problems += self._take_block(prefix, resolved, given, take)
        problems += [self._unknown(key) for key in given]
        problems.check()
        return {key: resolved[key] for key, _ in self.keys(resolved)}

    def reconfigure(self, current: Values, changes: Mapping[str, object]) -> Values:
        """The complete set after changes while a node runs, or ParameterError.

        A name removed from its list takes its block along.
        """
        kept = {key: value for key, value in current.items() if not self._orphan(key, changes)}
        resolved = self.resolve({**kept, **changes})
        Problems(
            Problem(key, describe(resolved[key]), f'{describe(current[key])} until a restart')
            for key, parameter in self.keys(resolved)
            if not parameter.reconfigurable and resolved[key] != current.get(key, resolved[key])
        ).check()
        return resolved

    def _take_block(
        self,
        prefix: str,
        resolved: Values,
        given: dict[str, object],
        take: Callable[[str, Parameter], None],
    ) -> list[Problem]:
        names_key = _names_key(prefix)
        if names_key not in resolved:
            # The list itself is refused: its parameters cannot be checked.
            for key in [key for key in given if self._block_of(key) == prefix]:
                del given[key]
            return []
        problems = []
        for name in resolved[names_key]:
            if _NAME.fullmatch(name) is None or prefix + name in self._single:
                wanted = 'a name of letters, digits and _, a letter first'
                if prefix + name in self._single:
                    wanted = f'another name: {prefix}{name} is a parameter'
                problems.append(Problem(names_key, describe(name), wanted))
                of_this = [key for key in given if str(key).startswith(f'{prefix}{name}.')]
                for key in of_this:
                    del given[key]
                continue
            for parameter in self._blocks[prefix]:
                take(parameter.key(name), parameter)
        for key in [key for key in given if self._block_of(key) == prefix]:
            del given[key]
            listed = f'a name listed in {names_key} {resolved[names_key]}'
            problems.append(Problem(key, 'a block that is not listed', listed))
        return problems

    def _block_of(self, key: object) -> str | None:
        parameter = self.find(key) if isinstance(key, str) else None
        return parameter.prefix if parameter is not None and parameter.is_block else None

    def _orphan(self, key: str, changes: Mapping[str, object]) -> bool:
        prefix = self._block_of(key)
        if prefix is None or _names_key(prefix) not in changes:
            return False
        names_key = _names_key(prefix)
        try:
            names = self._single[names_key].read(names_key, changes[names_key])
        except ParameterError:
            return False
        return key.removeprefix(prefix).partition('.')[0] not in names

    def _unknown(self, key: object) -> Problem:
        if not isinstance(key, str):
            return Problem(describe(key), 'no text', "a parameter's name")
        candidates = list(self._single)
        for block in self._blocks.values():
            # A prefix may be misspelt: it has as many dots, and the name is behind them.
            parts = key.split('.')
            name = parts[min(block[0].prefix.count('.'), len(parts) - 1)]
            candidates += [parameter.key(name) for parameter in block]
        # A block's name that is no name makes a key that is near itself.
        others = [candidate for candidate in candidates if candidate != key]
        nearest = difflib.get_close_matches(key, others, n=1)
        hint = f' (did you mean {nearest[0]}?)' if nearest else ''
        where = key if key.isprintable() and key else describe(key)
        return Problem(where, 'an unknown parameter', f'a known one{hint}')


def _names_key(prefix: str) -> str:
    return f'{prefix}names'
