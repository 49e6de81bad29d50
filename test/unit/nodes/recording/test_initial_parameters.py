"""What a node's parameters were before the first change, whichever is heard first."""

from __future__ import annotations

import itertools
import math

import pytest

from cmpsp_ros.nodes.recording.initial_parameters import InitialParameters


@pytest.fixture
def values():
    return InitialParameters()


def test_an_answer_alone(values):
    values.asked()
    values.answered({'gain': 1.5})
    assert values.known == {}
    values.settle()
    assert (values.known, values.latest, values.settled) == ({'gain': 1.5}, {'gain': 1.5}, True)


def test_a_change_after_the_answer_is_later(values):
    values.asked()
    values.answered({'gain': 1.5})
    values.settle()
    values.changed('gain', 9.0)
    assert (values.known, values.latest) == ({'gain': 1.5}, {'gain': 9.0})


def test_an_older_answer_that_is_overtaken_by_the_event_counts(values):
    values.asked()
    values.changed('gain', 9.0)
    values.answered({'gain': 1.5, 'name': 'a'})
    values.settle()
    assert values.known == {'gain': 1.5, 'name': 'a'}


@pytest.mark.parametrize('late', [False, True], ids=['event first', 'answer first'])
@pytest.mark.parametrize('answer', [8.0, 9.0])
def test_a_younger_answer_is_no_first_value(values, late, answer):
    values.asked()
    if late:
        values.answered({'gain': answer})
    values.changed('gain', 8.0)
    values.changed('gain', 9.0)
    if not late:
        values.answered({'gain': answer})
    values.settle()
    assert values.known == {}
    assert values.latest == {'gain': 9.0}


def test_a_change_before_the_question_leaves_the_value_unknown(values):
    values.changed('gain', 9.0)
    values.asked()
    values.changed('gain', 10.0)
    values.answered({'gain': 1.5, 'name': 'a'})
    values.settle()
    assert values.known == {'name': 'a'}


def test_a_declaration_that_was_heard_says_it_all(values):
    values.declared('gain', 1.5)
    values.changed('gain', 9.0)
    values.asked()
    values.answered({'gain': 9.0})
    values.settle()
    assert (values.known, values.latest) == ({'gain': 1.5}, {'gain': 9.0})


@pytest.mark.parametrize(('first', 'second'), [(math.nan, math.nan), (0.0, -0.0)])
def test_numbers_are_the_same_by_their_bits(values, first, second):
    values.asked()
    values.answered({'gain': first})
    values.changed('gain', second)
    values.settle()
    assert ('gain' in values.known) == (repr(first) != repr(second))


def test_without_an_answer_nothing_is_settled(values):
    values.asked()
    values.settle()
    assert not values.settled


def test_in_every_order_what_is_known_is_right():
    """A node that is changed at some times, and answers at some other; events come late."""
    for changes, asked, answers, heard in itertools.product(range(4), *[range(5)] * 2, range(3)):
        if asked > answers:
            continue
        values = InitialParameters()
        log = [(k + heard, 2, ('changed', 'gain', k + 1)) for k in range(changes)]
        log.append((asked, 0, ('asked',)))
        # At time t as many changes have been made as fit before it.
        log.append((answers, 1, ('answered', {'gain': min(answers, changes)})))
        for _, _, (name, *arguments) in sorted(log, key=lambda each: each[:2]):
            getattr(values, name)(*arguments)
        values.settle()
        assert values.known.get('gain', 0) == 0, (changes, asked, answers, heard)
        assert changes or values.known == {'gain': 0}
