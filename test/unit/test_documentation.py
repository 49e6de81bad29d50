"""Pages, the file of defaults and the JSON schema say what the code says."""

import re
from pathlib import Path

import pytest

from cmpsp_ros.parameters import TABLE, config_directory, load_parameter_file
from cmpsp_ros.parameters.files import preset_names

PROJECT = Path(__file__).parents[2]
TYPES = {'object': dict, 'array': list, 'string': str, 'boolean': bool, 'integer': int}


@pytest.fixture(scope='module')
def documentation(program):
    return program(PROJECT / '.ci' / 'documentation.py')


@pytest.fixture(scope='module')
def schema(documentation):
    return documentation.json_schema()


def nested(flat):
    root = {}
    for key, value in flat.items():
        *path, last = key.split('.')
        place = root
        for part in path:
            place = place.setdefault(part, {})
        place[last] = value
    return {'/**': {'ros__parameters': root}}


def is_valid(schema, value):
    """As much of JSON schema as the schema uses."""
    kind = schema.get('type')
    if kind == 'number':
        if not isinstance(value, (int, float)) or isinstance(value, bool):
            return False
    elif kind and type(value) is not TYPES[kind]:
        return False
    if kind == 'object':
        return all(key in value for key in schema.get('required', [])) and all(
            part is not False and is_valid(part, item)
            for key, item in value.items()
            for part in subschemas(schema, key)
        )
    if kind == 'array':
        return (
            schema.get('minItems', 0) <= len(value) <= schema.get('maxItems', len(value))
            and not (schema.get('uniqueItems') and len(set(value)) < len(value))
            and all(is_valid(schema['items'], item) for item in value)
        )
    return (
        value in schema.get('enum', [value])
        and ('minimum' not in schema or value >= schema['minimum'])
        and ('maximum' not in schema or value <= schema['maximum'])
        and ('exclusiveMinimum' not in schema or value > schema['exclusiveMinimum'])
    )


def subschemas(schema, key):
    found = [schema['properties'][key]] if key in schema.get('properties', {}) else []
    patterns = schema.get('patternProperties', {})
    found += [part for pattern, part in patterns.items() if re.search(pattern, key)]
    return found or [schema.get('additionalProperties', {})]


@pytest.mark.parametrize('name', preset_names())
def test_schema_accepts_the_presets(schema, name):
    assert is_valid(schema, nested(load_parameter_file(name, namespace='/r1')))


@pytest.mark.parametrize(
    'change',
    [
        {'frame': 'odom'}, {'goal.tolerance': 0.0}, {'goal.position': [1.0]},
        {'solver.hessian': 'newton'}, {'solver.iterations_per_step': 2.5}, {'autostart': 1},
        {'obstacles.names': ['a', 'a']}, {'moving_obstacles.c.radius': 1.0},
        {'obstacles.a.name': 1}, {'control_period': 11.0},
    ],
)  # fmt: skip
def test_schema_refuses_what_the_table_refuses(schema, change):
    assert not is_valid(schema, nested(load_parameter_file('case2') | change))


def test_schema_lets_parameters_of_ros_through(schema):
    change = {'use_sim_time': True, 'qos_overrides./odom.depth': 3}
    assert is_valid(schema, nested(load_parameter_file('case2') | change))
    assert is_valid(schema, {'camera': {'ros__parameters': {'gain': 1}}})


def test_table_has_one_row_for_each_parameter(documentation):
    lines = documentation.parameters_table().splitlines()
    rows = [line for line in lines if line.startswith('| `')]
    assert [row.split('`')[1] for row in rows] == [parameter.name for parameter in TABLE]
    assert {row.count('|') for row in rows} == {8}


def test_a_page_without_a_place_for_the_table_is_refused(documentation):
    with pytest.raises(LookupError, match='topics:begin'):
        documentation.with_section('nothing', 'topics', 'table')


def test_commands_and_packages_have_pages(documentation, tmp_path):
    documentation.main([str(tmp_path)])
    assert '## cmpsp audit\n' in (tmp_path / 'commands.md').read_text()
    assert '::: cmpsp_ros.world.' in (tmp_path / 'world.md').read_text()


def test_what_derives_from_code_is_up_to_date(documentation):
    for path, text in documentation.derived().items():
        assert path.read_text(encoding='utf-8') == text, path.name


def test_the_file_of_defaults_says_every_default_and_is_no_preset():
    given = load_parameter_file(config_directory() / 'defaults.yaml')
    assert given == {
        each.name: each.default for each in TABLE if not each.is_block and each.default != []
    }
    assert TABLE.resolve(given) == TABLE.resolve({})
    assert 'defaults' not in preset_names()
