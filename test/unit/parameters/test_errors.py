"""Messages about parameters: one line for each problem, whatever was found."""

import pickle

import pytest

from cmpsp_ros.parameters import ParameterError, Problem, describe


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
