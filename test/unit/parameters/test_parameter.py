"""One parameter: values accepted, converted and refused, and how that is said."""

import array
import math
import pickle

import numpy as np
import pytest

from cmpsp_ros.parameters import Parameter, ParameterError, Problem, describe
from cmpsp_ros.parameters.parameter import REQUIRED, ParameterType, Range

POSITIVE = Range(0.0, low_open=True)


def parameter(type_=ParameterType.DOUBLE, default=REQUIRED, **rest):
    return Parameter('key', type_, default, 'm', 'Text.', 'Group', frozenset({'sim'}), **rest)


def refusal(row, value):
    with pytest.raises(ParameterError) as caught:
        row.read('key', value)
    return str(caught.value)


@pytest.mark.parametrize('value', [2, 2.0, np.float32(2.0), np.int64(2), np.array(2.0)])
def test_numbers_of_any_kind_become_floats(value):
    read = parameter().read('key', value)
    assert type(read) is float
    assert read == 2.0


@pytest.mark.parametrize(
    'value', [[1, 2], (1.0, 2), array.array('d', [1.0, 2.0]), array.array('q', [1, 2]),
              np.array([1.0, 2.0]), np.array([1, 2]), [np.float64(1.0), np.int32(2)]],
)  # fmt: skip
def test_sequences_of_any_kind_become_lists_of_floats(value):
    read = parameter(ParameterType.DOUBLE_ARRAY, length=2).read('key', value)
    assert read == [1.0, 2.0]
    assert [type(item) for item in read] == [float, float]


@pytest.mark.parametrize(
    ('row', 'wanted', 'values'),
    [
        (parameter(range=POSITIVE), 'a number > 0 [m]',
         [True, np.True_, None, 'x', [1.0], math.nan, math.inf, 10**400]),
        (parameter(ParameterType.INTEGER, range=Range(1, 100)), 'an integer from 1 to 100 [m]',
         [2.0, True, '2', 2**63, [2], 0, 101]),
        (parameter(ParameterType.INTEGER), 'an integer', [2**63]),
        (parameter(ParameterType.BOOL), 'true or false', [0, 1, 'true', None, [True]]),
        (parameter(ParameterType.STRING), 'text, not empty',
         ['', ' ', 'a\nb', 'a\0b', '\ud800', 1, True, None, b'odom']),
        (parameter(ParameterType.DOUBLE_ARRAY, length=2), 'a list of 2 numbers [m]',
         [[1.0], [1.0, 2.0, 3.0], [1.0, True], [1.0, math.nan], 'ab', 1.0, None,
          [[1.0, 2.0], [3.0, 4.0]], np.eye(2), {}]),
        (parameter(ParameterType.STRING_ARRAY), 'a list of different names',
         [['a', 'a'], ['a', 1], ['a', ''], 'a', [['a']], {'a': 1}]),
    ],
)  # fmt: skip
def test_what_is_refused_says_what_was_wanted(row, wanted, values):
    for value in values:
        assert f'wanted {wanted}' in refusal(row, value), value


def test_integers_have_up_to_64_bits():
    assert parameter(ParameterType.INTEGER).read('key', 2**63 - 1) == 2**63 - 1


def test_message_names_key_found_and_wanted():
    assert refusal(parameter(range=POSITIVE), -0.5) == 'key: found -0.5, wanted a number > 0 [m]'


def test_choices_are_listed():
    row = parameter(ParameterType.STRING, choices=('exact', 'gauss_newton'))
    assert row.read('key', np.str_('exact')) == 'exact'
    assert refusal(row, 'newton') == "key: found 'newton', wanted exact or gauss_newton"


def test_an_empty_list_that_lost_its_type_in_ros_is_an_empty_list():
    row = parameter(ParameterType.STRING_ARRAY)
    assert row.read('key', None) == []
    assert row.read('key', []) == []


@pytest.mark.parametrize(
    ('type_', 'value', 'hint'),
    [
        (ParameterType.DOUBLE, '1e-3', '(this is text: write 0.001 without quotes)'),
        (ParameterType.DOUBLE_ARRAY, [1.0, '2'], '(this is text: write 2.0 without quotes)'),
        (ParameterType.INTEGER, '3', '(this is text: write 3 without quotes)'),
        (ParameterType.BOOL, 'True', '(this is text: write true without quotes)'),
        (ParameterType.STRING, True, '(put it in quotes to make it text)'),
        (ParameterType.STRING_ARRAY, [True, False], '(put it in quotes to make it text)'),
    ],
)
def test_the_usual_slips_of_yaml_are_explained(type_, value, hint):
    assert refusal(parameter(type_), value).endswith(hint)


def test_an_underscore_makes_text_of_digits_also_without_quotes():
    assert refusal(parameter(), '5_1') == "key: found '5_1', wanted a number [m]"


@pytest.mark.parametrize(
    ('interval', 'inside', 'outside', 'text'),
    [
        (Range(), [-1e300, 0.0], [], ''),
        (Range(0.0), [0.0, 1.0], [-1e-9], '>= 0'),
        (Range(0.0, low_open=True), [5e-324], [0.0], '> 0'),
        (Range(high=1.0), [1.0], [1.1], '<= 1'),
        (Range(0.01, 10.0), [0.01, 10.0], [0.0, 11.0], 'from 0.01 to 10'),
        (Range(0.0, 1.0, True, True), [0.5], [0.0, 1.0], '> 0 and < 1'),
    ],
)
def test_ranges(interval, inside, outside, text):
    assert str(interval) == text
    assert all(number in interval for number in inside)
    assert not any(number in interval for number in outside)


def test_a_default_is_a_copy():
    row = parameter(ParameterType.DOUBLE_ARRAY, [1.0, 2.0])
    row.read_default('key').append(3.0)
    assert row.read_default('key') == [1.0, 2.0]


def test_message_has_one_line_for_each_problem():
    error = ParameterError(Problem('a', '1', '2'), Problem('b', '3', '4'))
    assert str(error) == 'a: found 1, wanted 2\nb: found 3, wanted 4'
    assert isinstance(error, ValueError)


def test_error_survives_a_process_boundary():
    error = pickle.loads(pickle.dumps(ParameterError(Problem('a', '1', '2'))))
    assert error.problems == (Problem('a', '1', '2'),)


class _Unspeakable:
    def __repr__(self):
        raise RuntimeError


@pytest.mark.parametrize(
    ('value', 'text'),
    [
        (None, 'nothing'),
        (True, 'true'),
        (False, 'false'),
        (-0.5, '-0.5'),
        ('1e-3', "'1e-3'"),
        (_Unspeakable(), 'a value of type _Unspeakable'),
        ('x' * 200, "'" + 'x' * 76 + '...'),
        ([1, 2], '[1, 2]'),
    ],
)
def test_values_are_described_in_one_bounded_line(value, text):
    assert describe(value) == text


def test_an_integer_too_long_to_print_is_described():
    assert len(describe(10**5000)) <= 80
