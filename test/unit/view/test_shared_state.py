"""Shared state: told once, in plain values, and never more than was asked for."""

import json
import math

import pytest

from cmpsp_ros.view import SharedState, server
from cmpsp_ros.view.server import ClientState


@pytest.fixture
def state():
    return SharedState(['path'])


def known(updates):
    """State of a browser after these updates."""
    rows = {name: updates['first'][name] + len(rows) for name, rows in updates['series'].items()}
    return ClientState(updates['course_number'], updates['run'], rows)


def test_a_new_browser_is_told_everything_and_then_only_what_is_new(state):
    state.show_course(['a road'])
    state.show('place', (1.0, 2.0))
    state.add('path', [1.0, 2.0])
    first = state.updates(ClientState())
    assert (first['course'], first['place']) == (['a road'], [1.0, 2.0])
    assert first['series'] == {'path': [[1.0, 2.0]]}
    state.add('path', [3.0, 4.0])
    second = state.updates(known(first))
    assert 'course' not in second
    assert (second['first'], second['series']) == ({'path': 1}, {'path': [[3.0, 4.0]]})
    assert state.updates(known(second))['series'] == {'path': []}


def test_a_changed_course_is_told_again(state):
    state.show_course(['a road'])
    before = known(state.updates(ClientState()))
    state.show_course(['another'])
    assert state.updates(before)['course'] == ['another']


def test_with_another_run_the_series_begin_again(state):
    state.add('path', [1.0, 2.0])
    before = known(state.updates(ClientState()))
    state.begin()
    state.add('path', [5.0, 6.0])
    updates = state.updates(before)
    assert (updates['first'], updates['series']) == ({'path': 0}, {'path': [[5.0, 6.0]]})


def test_a_series_that_is_full_begins_again(state):
    for number in range(server.LONGEST + 1):
        state.add('path', [float(number), 0.0])
    assert state.updates(ClientState())['series'] == {'path': [[float(server.LONGEST), 0.0]]}


def test_whatever_is_shown_is_json(state):
    state.show('odd', {'a': math.nan, 'b': [math.inf, (1.0, -math.inf)], 'c': None, 'd': 'x'})
    state.add('path', [math.nan, 1.0])
    updates = state.updates(ClientState())
    assert json.loads(json.dumps(updates, allow_nan=False))['odd'] == {
        'a': None, 'b': [None, [1.0, None]], 'c': None, 'd': 'x',
    }  # fmt: skip


def test_silence_is_counted_from_the_last_sign_of_life(state):
    assert state.updates(ClientState())['silence'] is None
    state.alive()
    first = state.updates(ClientState())['silence']
    assert 0.0 <= first <= state.updates(ClientState())['silence']


def test_a_browser_that_claims_to_have_more_is_told_nothing_wrong(state):
    state.add('path', [1.0, 2.0])
    assert state.updates(ClientState(0, 0, {'path': 99, 'none': 5}))['series'] == {'path': []}
