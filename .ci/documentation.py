"""Pages and files that derive from code, in doc/reference/ and config/; and the JSON schema.

`.ci/documentation.py` writes topics.md, parameters.md and defaults.yaml again; with
a folder, commands.md and the page of each package into it; with --schema, it prints the schema for
editors of parameter files.
"""

import itertools
import json
import math
import sys
import textwrap
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import typer.main

from cmpsp_ros.cli import app
from cmpsp_ros.nodes.common.topics import TOPICS, TRANSFORMS
from cmpsp_ros.parameters.catalogue import TABLE
from cmpsp_ros.parameters.files import dump
from cmpsp_ros.parameters.parameter import NAME, REQUIRED, Parameter, ParameterType

ROOT: Final = Path(__file__).parents[1]
PACKAGES: Final = ('mpsp', 'robots', 'world', 'guidance')
_HEAD: Final = (
    '| Parameter | Default | Unit | Allowed | Live | Node | Meaning |\n' + '|---' * 7 + '|'
)
_DEFAULTS_HEAD: Final = """\
# Every parameter of both nodes with its default. Copy what you change into a file of your own, as
# the presets beside this file do: it needs a road, and a goal or follow.speed.
#
# Written by make docs

/**:
  ros__parameters:"""
_JSON_TYPE: Final = {
    ParameterType.BOOL: 'boolean',
    ParameterType.INTEGER: 'integer',
    ParameterType.DOUBLE: 'number',
    ParameterType.STRING: 'string',
}


def topics_table() -> str:
    """The topics and services of all nodes."""
    rows = ['| node | | name | type | notes |', '|---|---|---|---|---|']
    for each in TOPICS:
        package = each.type.__module__.partition('.')[0]
        kind = f'{package}/{each.type.__name__}'
        rows.append(f'| {each.node} | {each.direction} | `{each.name}` | {kind} | {each.notes} |')
    for node, direction, name, notes in TRANSFORMS:
        rows.append(f'| {node} | {direction} | {name} | tf2_msgs/TFMessage | {notes} |')
    return '\n'.join(rows)


def parameters_table() -> str:
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


def commands_page() -> str:
    """Help of every command, in Markdown."""
    parts = ['# Commands\n\n[Exit codes](exit_codes.md) are listed apart.\n']
    for name, command in typer.main.get_group(app).commands.items():
        with command.make_context(f'cmpsp {name}', [], resilient_parsing=True) as context:
            parts.append(f'## cmpsp {name}\n\n```text\n{command.get_help(context)}\n```\n')
    return '\n'.join(parts)


def package_page(name: str) -> str:
    """Names that a package offers, as directives for mkdocstrings."""
    package = import_module(f'cmpsp_ros.{name}')
    homes = {each: getattr(getattr(package, each), '__module__', '') for each in package.__all__}
    offered = [f'::: {home}.{each}' for each, home in homes.items() if home.startswith('cmpsp_ros')]
    return '\n\n'.join([f'# cmpsp_ros.{name}', package.__doc__ or '', *offered, ''])


def with_section(text: str, name: str, content: str) -> str:
    """Replace the text between `<!-- name:begin -->` and `<!-- name:end -->`."""
    before, begin, rest = text.partition(f'<!-- {name}:begin -->')
    _, end, after = rest.partition(f'<!-- {name}:end -->')
    if not begin or not end:
        raise LookupError(f'no {name}:begin and {name}:end')
    return f'{before}{begin}\n\n{content}\n{end}{after}'


def derived() -> dict[Path, str]:
    """Files of the repository that this script writes, as they are to be."""
    files = {ROOT / 'config' / 'defaults.yaml': defaults_file()}
    for name, table in {'topics': topics_table(), 'parameters': parameters_table()}.items():
        page = ROOT / 'doc' / 'reference' / f'{name}.md'
        files[page] = with_section(page.read_text(encoding='utf-8'), name, table)
    return files


def main(arguments: list[str]) -> None:
    """Write files of the repository, or pages into a folder; or print the schema."""
    if arguments == ['--schema']:
        sys.stdout.write(f'{json.dumps(json_schema(), indent=2)}\n')
        return
    files = {} if arguments else derived()
    for argument in arguments:
        files[Path(argument) / 'commands.md'] = commands_page()
        files |= {Path(argument) / f'{each}.md': package_page(each) for each in PACKAGES}
    for path, text in files.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding='utf-8')


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
    main(sys.argv[1:])
