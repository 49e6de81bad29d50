"""What is shown: told once, in plain values, and never more than was asked for."""

from __future__ import annotations

import json
import math

import pytest

from cmpsp_ros.view import board as board_module
from cmpsp_ros.view.board import Board, Known


@pytest.fixture
def board():
    return Board(['path'])


def known(news):
    """What a browser has that was told this."""
    rows = {name: news['first'][name] + len(rows) for name, rows in news['series'].items()}
    return Known(news['course_number'], news['run'], rows)


def test_a_new_browser_is_told_everything_and_then_only_what_is_new(board):
    board.show_course(['a road'])
    board.show('place', (1.0, 2.0))
    board.add('path', [1.0, 2.0])
    first = board.news(Known())
    assert (first['course'], first['place']) == (['a road'], [1.0, 2.0])
    assert first['series'] == {'path': [[1.0, 2.0]]}
    board.add('path', [3.0, 4.0])
    second = board.news(known(first))
    assert 'course' not in second
    assert (second['first'], second['series']) == ({'path': 1}, {'path': [[3.0, 4.0]]})
    assert board.news(known(second))['series'] == {'path': []}


def test_a_changed_course_is_told_again(board):
    board.show_course(['a road'])
    before = known(board.news(Known()))
    board.show_course(['another'])
    assert board.news(before)['course'] == ['another']


def test_with_another_run_the_series_begin_again(board):
    board.add('path', [1.0, 2.0])
    before = known(board.news(Known()))
    board.begin()
    board.add('path', [5.0, 6.0])
    news = board.news(before)
    assert (news['first'], news['series']) == ({'path': 0}, {'path': [[5.0, 6.0]]})


def test_a_series_that_is_full_begins_again(board, monkeypatch):
    monkeypatch.setattr(board_module, 'LONGEST', 3)
    for number in range(4):
        board.add('path', [float(number), 0.0])
    assert board.news(Known())['series'] == {'path': [[3.0, 0.0]]}


def test_whatever_is_shown_is_json(board):
    board.show('odd', {'a': math.nan, 'b': [math.inf, (1.0, -math.inf)], 'c': None, 'd': 'x'})
    board.add('path', [math.nan, 1.0])
    news = board.news(Known())
    assert json.loads(json.dumps(news, allow_nan=False))['odd'] == {
        'a': None, 'b': [None, [1.0, None]], 'c': None, 'd': 'x',
    }  # fmt: skip


def test_silence_is_counted_from_the_last_sign_of_life(board):
    assert board.news(Known())['silence'] is None
    board.alive()
    first = board.news(Known())['silence']
    assert 0.0 <= first <= board.news(Known())['silence']


def test_a_browser_that_claims_to_have_more_is_told_nothing_wrong(board):
    board.add('path', [1.0, 2.0])
    assert board.news(Known(0, 0, {'path': 99, 'none': 5}))['series'] == {'path': []}
