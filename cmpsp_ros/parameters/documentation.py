"""The parameter table as documentation, as a file of all defaults, and as JSON schema for editors.

``python -m cmpsp_ros.parameters.documentation`` prints them, or writes the table into a page.
"""

import argparse
import itertools
import json
import math
import sys
import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

from cmpsp_ros.parameters.catalogue import TABLE
from cmpsp_ros.parameters.errors import ParameterError, Problem
from cmpsp_ros.parameters.files import dump
from cmpsp_ros.parameters.parameter import NAME, REQUIRED, Parameter, ParameterType

_HEAD: Final = (
    '| Parameter | Default | Unit | Allowed | Live | Node | Meaning |\n' + '|---' * 7 + '|'
)
_DEFAULTS_HEAD: Final = """\
# Every parameter of both nodes with its default. Copy what you change into a file of your own, as
# the presets beside this file do: it needs a road, and a goal or follow.speed.
#
# Written by python -m cmpsp_ros.parameters.documentation --defaults

/**:
  ros__parameters:"""
_JSON_TYPE: Final = {
    ParameterType.BOOL: 'boolean',
    ParameterType.INTEGER: 'integer',
    ParameterType.DOUBLE: 'number',
    ParameterType.STRING: 'string',
}


def markdown_table() -> str:
    """The parameters under their headings."""
    parts = []
    for group, parameters in itertools.groupby(TABLE, key=lambda parameter: parameter.group):
        rows = '\n'.join(_row(parameter) for parameter in parameters)
        parts.append(f'**{group}**\n\n{_HEAD}\n{rows}\n')
    return '\n'.join(parts)


def json_schema() -> dict[str, Any]:
    """JSON schema (draft 2020-12) of a parameter file, for editors that check YAML."""
    parameters: dict[str, Any] = _mapping()
    for parameter in TABLE:
        _insert(parameters, parameter)
    parameters['properties'] |= {
        'use_sim_time': {'type': 'boolean'},
        'start_type_description_service': {'type': 'boolean'},
        'qos_overrides': {'type': 'object'},
    }
    parameters['patternProperties'] = {r'^qos_overrides\.': {}}
    section = {
        'type': 'object',
        'properties': {'ros__parameters': parameters},
        'required': ['ros__parameters'],
    }
    return {
        '$schema': 'https://json-schema.org/draft/2020-12/schema',
        'title': 'Parameters of the guidance node and the simulator',
        'type': 'object',
        'patternProperties': {r'^/\*\*$|^(.*/)?(guidance|sim)$': section},
    }


def defaults_file() -> str:
    """A parameter file for all nodes with every default; required parameters are comments."""
    rows = [_DEFAULTS_HEAD]
    for group, parameters in itertools.groupby(TABLE, key=lambda parameter: parameter.group):
        rows.append(f'\n    # --- {group} ---')
        for each in parameters:
            unit = f' [{each.unit}]' if each.unit else ''
            rows += ['', *(f'    # {row}' for row in textwrap.wrap(each.description + unit, 94))]
            if each.is_block or each.default == []:
                rows.append(f'    # {each.name}: {_default(each).strip("`")}')
            else:
                rows.append(dump({each.name: each.default}).splitlines()[-1])
    return '\n'.join(rows) + '\n'


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table, the file or the schema, or write the table into a page."""
    parser = argparse.ArgumentParser(description=__doc__, prog='documentation')
    choice = parser.add_mutually_exclusive_group()
    choice.add_argument('--write', metavar='PAGE.md', type=Path, help='replace the table in it')
    choice.add_argument('--defaults', action='store_true', help='print the file of defaults')
    choice.add_argument('--schema', action='store_true', help='print the JSON schema')
    given = parser.parse_args(arguments)
    if given.write is None:
        schema = f'{json.dumps(json_schema(), indent=2)}\n' if given.schema else ''
        sys.stdout.write(schema or (defaults_file() if given.defaults else f'{markdown_table()}\n'))
        return 0
    try:
        text = given.write.read_text(encoding='utf-8')
        table = with_section(text, 'parameters', markdown_table(), str(given.write))
        given.write.write_text(table, encoding='utf-8')
    except (OSError, ParameterError) as error:
        sys.stderr.write(f'{error}\n')
        return 1
    return 0


def with_section(text: str, name: str, content: str, source: str) -> str:
    """Replace the text between `<!-- name:begin -->` and `<!-- name:end -->`; ParameterError."""
    mark_begin, mark_end = f'<!-- {name}:begin -->', f'<!-- {name}:end -->'
    before, begin, rest = text.partition(mark_begin)
    _, end, after = rest.partition(mark_end)
    if not begin or not end:
        wanted = f'{mark_begin} and after it {mark_end}, each once'
        raise ParameterError(Problem(source, 'no place for the table', wanted))
    return f'{before}{mark_begin}\n\n{content}\n{mark_end}{after}'


def _row(parameter: Parameter) -> str:
    cells = [
        f'`{parameter.name}`',
        _default(parameter),
        parameter.unit,
        _allowed(parameter),
        'yes' if parameter.reconfigurable else 'no',
        ', '.join(sorted(parameter.nodes)),
        parameter.description,
    ]
    return f'| {" | ".join(cell.replace("|", chr(92) + "|") for cell in cells)} |'


def _default(parameter: Parameter) -> str:
    if parameter.default is REQUIRED:
        return 'required'
    if parameter.default == []:
        return '`[]`'
    written = dump({'': parameter.default}).splitlines()[-1].partition(': ')[2]
    plain = written.replace('"', '') or "''"
    return f'`{plain}`'


def _allowed(parameter: Parameter) -> str:
    if parameter.choices:
        return ', '.join(f'`{choice}`' for choice in parameter.choices)
    length = '' if parameter.length is None else f'{parameter.length} '
    return f'{length if parameter.is_array else ""}{parameter.type.value} {parameter.range}'.strip()


def _mapping() -> dict[str, Any]:
    return {'type': 'object', 'properties': {}, 'additionalProperties': False}


def _insert(root: dict[str, Any], parameter: Parameter) -> None:
    *path, last = parameter.name.split('.')
    mapping = root
    for part in path:
        if part == NAME:
            if mapping['additionalProperties'] is False:
                mapping['additionalProperties'] = _mapping() | {'required': []}
            mapping = mapping['additionalProperties']
        else:
            mapping = mapping['properties'].setdefault(part, _mapping())
    mapping['properties'][last] = _value_schema(parameter)
    if parameter.default is REQUIRED:
        mapping['required'].append(last)


def _value_schema(parameter: Parameter) -> dict[str, Any]:
    limits = parameter.range
    item: dict[str, Any] = {'type': _JSON_TYPE[parameter.type.item]}
    if limits.low > -math.inf:
        item['exclusiveMinimum' if limits.low_open else 'minimum'] = limits.low
    if limits.high < math.inf:
        item['exclusiveMaximum' if limits.high_open else 'maximum'] = limits.high
    if parameter.choices:
        item['enum'] = list(parameter.choices)
    schema = item
    if parameter.is_array:
        schema = {'type': 'array', 'items': item}
        if parameter.type is ParameterType.STRING_ARRAY:
            schema['uniqueItems'] = True
        if parameter.length is not None:
            schema |= {'minItems': parameter.length, 'maxItems': parameter.length}
    unit = f' [{parameter.unit}]' if parameter.unit else ''
    schema['description'] = parameter.description + unit
    if parameter.default is not REQUIRED:
        schema['default'] = parameter.default
    return schema


if __name__ == '__main__':
    sys.exit(main())
