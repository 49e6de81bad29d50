"""YAML as ROS reads it: scalars, sections, and what is refused with file and line."""

import contextlib
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cmpsp_ros.parameters import ParameterError
from cmpsp_ros.parameters.files import ros_yaml


# What rcl_yaml_param_parser of ROS 2 Jazzy was seen to make of each.
@pytest.mark.parametrize(
    ('text', 'value'),
    [
        ('1e-3', 1e-3), ('1.0e-3', 1e-3), ('.5', 0.5), ('5.', 5.0), ('-0.0', -0.0),
        ('0x10', 16), ('010', 8), ('09', 9.0), ('0', 0), ('-7', -7), ('+7', 7),
        ('99999999999999999999', 1e20), ('0x0.0000000000001p-1022', 5e-324),
        ('1_000', '1_000'), ('1:30', '1:30'), ('2001-01-01', '2001-01-01'),
        ('~', '~'), ('null', 'null'), ('y', True), ('no', False), ('On', True), ('oN', 'oN'),
        ('"1"', '1'), ("'true'", 'true'), ('٣', '٣'), ('0x1p99999', '0x1p99999'),
        ('inf', math.inf), ('-.INF', -math.inf), ('[]', []), ('[1, 2]', [1, 2]),
        ('[a, "b"]', ['a', 'b']), ('daqp # fast', 'daqp'),
    ],
)  # fmt: skip
def test_values(text, value):
    read = ros_yaml.read_value(text, 'key')
    assert type(read) is type(value)
    assert repr(read) == repr(value)


def test_not_a_number():
    assert math.isnan(ros_yaml.read_value('.nan', 'key'))


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('', 'key: found nothing, wanted a value'),
        ('{a: 1}', "key: found the mapping '{a: 1}', wanted a value"),
        ('[[1], [2]]', 'key: found a list of lists or mappings, wanted a value'),
        ('[1, 2', "key, line 1: found expected ',' or ']'"),
        ('a\x00b', 'key: found '),
        ('[' * 1000, 'wanted YAML'),
        ('[&x 1, *x]', 'key, line 1: found an alias *x, wanted a value'),
    ],
)
def test_what_is_no_value_is_refused(text, message):
    with pytest.raises(ParameterError) as caught:
        ros_yaml.read_value(text, 'key')
    assert message in str(caught.value)


def test_sections_nested_and_dotted_are_the_same():
    text = """
/**:
  ros__parameters:
    goal: {position: [1.0, 2.0]}
    goal.tolerance: 0.1
r1:
  guidance:
    ros__parameters:
      robot: {radius: 0.2}
/r1/guidance:
  ros__parameters: {robot.half_track: 0.1}
"""
    assert ros_yaml.read_sections(text, 'file') == {
        '/**': {'goal.position': [1.0, 2.0], 'goal.tolerance': 0.1},
        '/r1/guidance': {'robot.radius': 0.2, 'robot.half_track': 0.1},
    }


@pytest.mark.parametrize(
    ('text', 'message'),
    [
        ('', 'file: found no section ros__parameters, wanted a file of ROS parameters'),
        ('[1]', 'file: found no section ros__parameters'),
        ('frame_id: odom', 'file, line 1: found a value without ros__parameters around it'),
        ('ros__parameters: {a: 1}', 'file, line 1: found no node, wanted "/**:"'),
        ('/**:\n  ros__parameters:', 'file, line 2: found a value without'),
        ('/**:\n  ros__parameters:\n    a:\n', 'file, line 3: a: found nothing, wanted a value'),
        ('/**:\n  ros__parameters:\n    a: 1\n    a: 2', 'file, line 4: found a for the second'),
        ('/**:\n  ros__parameters:\n    a: [1.0, 2]', 'line 3: a: found [1.0, 2], wanted items of'),
        ('/**:\n  ros__parameters:\n    [a]: 1', 'file, line 3: found a list or mapping, wanted'),
        ('/**:\n  ros__parameters:\n   a: b: c', 'file, line 3: found mapping values are not'),
        ('? [a]\n: {b: 1}', 'file, line 1: found a value without'),
        ('a: &x 1\nb: *x', 'file, line 2: found an alias *x'),
        ('a: 1\n---\nb: 2', 'wanted YAML'),
    ],
)
def test_what_is_no_file_of_parameters_is_refused_with_its_line(text, message):
    with pytest.raises(ParameterError) as caught:
        ros_yaml.read_sections(text, 'file')
    assert message in str(caught.value)


def test_floats_are_written_so_that_ros_reads_floats():
    values = {'a': 1e-07, 'b': 1e16, 'c': 2.0, 'd': 5e-324, 'e': math.inf, 'f': True, 'g': []}
    assert ros_yaml.dump(values) == (
        '/**:\n  ros__parameters:\n    a: 1.0e-07\n    b: 1.0e+16\n    c: 2.0\n'
        '    d: 0x0.0000000000001p-1022\n    e: .inf\n    f: true\n'
    )


def test_an_empty_set_is_written_and_read():
    assert ros_yaml.read_sections(ros_yaml.dump({'a': []}), 'file') == {'/**': {}}


TEXTS = st.text(st.characters(exclude_categories=['Cs']))
VALUES = (
    st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False) | TEXTS
    | st.lists(st.floats(allow_nan=False), min_size=1) | st.lists(TEXTS, min_size=1)
)  # fmt: skip


@given(st.dictionaries(st.from_regex(r'[a-z]{1,3}(\.[a-z_]{1,5})?', fullmatch=True), VALUES))
def test_what_is_written_reads_back_bit_for_bit(values):
    read = ros_yaml.read_sections(ros_yaml.dump(values), 'file')['/**']
    assert repr(read) == repr(values)


@given(st.text() | st.text('/*: {}[]ab1.&!-?|>"\'\n#,', max_size=30))
def test_any_text_is_read_or_refused(text):
    for read in (ros_yaml.read_sections, ros_yaml.read_value):
        with contextlib.suppress(ParameterError):
            read(text, 'file')
