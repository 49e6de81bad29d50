"""Parameter files, read and written by the rules of ROS's own parser.

PyYAML's rules differ: it reads ``1e-3`` as text, ``1_000`` as a number and ``1:30`` as 90. A file
must mean the same here and to a node that ROS passes it to.
"""

import math
import re
import sys
from collections.abc import Iterator, Mapping
from typing import Any, Final

import yaml

from cmpsp_ros.parameters.errors import ParameterError, Problem, describe

Sections = dict[str, dict[str, Any]]  # flat parameters by node, in order of appearance

_MARK: Final = 'ros__parameters'
_TRUE: Final = re.compile(r'[Yy]|yes|Yes|YES|true|True|TRUE|on|On|ON')
_FALSE: Final = re.compile(r'[Nn]|no|No|NO|false|False|FALSE|off|Off|OFF')
_INTEGER: Final = re.compile(r'[+-]?(0[xX][0-9a-fA-F]+|0[0-7]*|[1-9][0-9]{0,18})')
_HEX: Final = re.compile(r'[+-]?0[xX][0-9a-fA-F.]+([pP][+-]?[0-9]{1,6})?')
_FLOAT: Final = re.compile(
    r'[+-]?([0-9]+\.?[0-9]*([eE][+-]?[0-9]+)?|\.[0-9]+([eE][+-]?[0-9]+)?|\.?(inf|nan))',
    re.IGNORECASE,
)


def read_sections(text: str, source: str) -> Sections:
    """Flat parameters of each node that a file names, nested names too, or ParameterError."""
    root = _compose(text, source)
    sections: Sections = {}
    if isinstance(root, yaml.MappingNode):
        _collect(root, '', sections, source)
    if not sections:
        wanted = f'a file of ROS parameters: a line "/**:", below it "{_MARK}:", below it they'
        raise ParameterError(Problem(source, f'no section {_MARK}', wanted))
    return sections


def read_value(text: str, source: str) -> Any:
    """One value in YAML, a scalar or a list of scalars, or ParameterError."""
    node = _compose(text, source)
    if node is None or isinstance(node, yaml.MappingNode):
        found = 'nothing' if node is None else f'the mapping {describe(text)}'
        raise ParameterError(Problem(source, found, 'a value or a list of values'))
    return _value(node, source)


def dump(values: Mapping[str, Any], namespace: str = '') -> str:
    """Parameter file for all nodes of a namespace, without empty lists: it reads back exactly."""
    rows = [f'    {key}: {_written(value)}' for key, value in values.items() if value != []]
    return '\n'.join([f'{namespace}/**:', f'  {_MARK}:' if rows else f'  {_MARK}: {{}}', *rows, ''])


def _compose(text: str, source: str) -> Any:
    try:
        for event in yaml.parse(text, Loader=yaml.BaseLoader):
            if isinstance(event, yaml.AliasEvent):
                where = _at(source, event)
                raise ParameterError(Problem(where, f'an alias *{event.anchor}', 'a value'))
        return yaml.compose(text, Loader=yaml.BaseLoader)
    except yaml.MarkedYAMLError as error:
        where = source if error.problem_mark is None else _at_mark(source, error.problem_mark)
        found = str(error.problem or error.context)
        raise ParameterError(Problem(where, found, 'YAML')) from error
    except (yaml.YAMLError, RecursionError) as error:
        raise ParameterError(Problem(source, describe(str(error)), 'YAML')) from error


def _collect(node: Any, name: str, sections: Sections, source: str) -> None:
    for key, value in node.value:
        if not isinstance(key, yaml.ScalarNode) or not isinstance(value, yaml.MappingNode):
            wanted = f'"/**:" or a node\'s name, and below it {_MARK} with all values'
            found = f'a value without {_MARK} around it'
            raise ParameterError(Problem(_at(source, key), found, wanted))
        if key.value == _MARK:
            if not name:
                wanted = f'"/**:" or a node\'s name around {_MARK}'
                raise ParameterError(Problem(_at(source, key), 'no node', wanted))
            _fill(sections.setdefault(name, {}), value, source)
        else:
            _collect(value, f'{name.rstrip("/")}/{key.value.lstrip("/")}', sections, source)


def _fill(section: dict[str, Any], node: Any, source: str) -> None:
    for key, value, line in _flat(node, '', source):
        if key in section:
            raise ParameterError(Problem(line, f'{key} for the second time', 'it once'))
        section[key] = value


def _flat(node: Any, prefix: str, source: str) -> Iterator[tuple[str, Any, str]]:
    for key, value in node.value:
        if not isinstance(key, yaml.ScalarNode):
            raise ParameterError(Problem(_at(source, key), 'a list or mapping', 'a key'))
        if isinstance(value, yaml.MappingNode):
            yield from _flat(value, f'{prefix}{key.value}.', source)
            continue
        full, line = prefix + key.value, _at(source, key)
        plain = _value(value, f'{line}: {full}')
        kinds = {type(item) for item in plain} if isinstance(plain, list) else set()
        if len(kinds) > 1:
            wanted = 'items of one type (a decimal point in every number, or quotes): ROS wants it'
            raise ParameterError(Problem(f'{line}: {full}', describe(plain), wanted))
        yield full, plain, line


def _value(node: Any, where: str) -> Any:
    if isinstance(node, yaml.SequenceNode):
        if any(not isinstance(item, yaml.ScalarNode) for item in node.value):
            wanted = 'a value or a list of values'
            raise ParameterError(Problem(where, 'a list of lists or mappings', wanted))
        return [_value(item, where) for item in node.value]
    if node.value == '' and node.style is None:
        raise ParameterError(Problem(where, 'nothing', 'a value or a list of values'))
    return node.value if node.style in {'"', "'"} else _scalar(node.value)


def _scalar(text: str) -> bool | int | float | str:
    if _TRUE.fullmatch(text):
        return True
    if _FALSE.fullmatch(text):
        return False
    if _INTEGER.fullmatch(text):
        digits = text.lstrip('+-')
        base = 16 if digits[1:2] in {'x', 'X'} else 8 if digits.startswith('0') else 10
        integer = int(text, base)
        if -(2**63) <= integer < 2**63:
            return integer
    try:
        if _HEX.fullmatch(text):
            return float.fromhex(text)
        if _FLOAT.fullmatch(text):
            return float(re.sub(r'\.(?=[in])', '', text, flags=re.IGNORECASE))
    except (ValueError, OverflowError):
        return text
    return text


def _written(value: Any) -> str:
    if isinstance(value, bool):
        return 'true' if value else 'false'
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return _written_float(value)
    if isinstance(value, str):
        dumped: str = yaml.dump(value, default_style='"', allow_unicode=True, width=math.inf)
        return dumped.rstrip('\n')
    return f'[{", ".join(_written(item) for item in value)}]'


def _written_float(value: float) -> str:
    if not math.isfinite(value):
        return {'inf': '.inf', '-inf': '-.inf'}.get(repr(value), '.nan')
    if 0.0 < abs(value) < sys.float_info.min:
        # ROS refuses a decimal number that underflows, though not an exact one.
        return value.hex()
    text = float.__repr__(value)
    return text if '.' in text else text.replace('e', '.0e')


def _at(source: str, node: Any) -> str:
    return _at_mark(source, node.start_mark)


def _at_mark(source: str, mark: Any) -> str:
    return f'{source}, line {mark.line + 1}'
