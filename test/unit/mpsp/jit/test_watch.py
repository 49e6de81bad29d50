"""Compilations are noticed, by name, and shown; loading and the kernels of others are not."""

import io

import numba
import pytest

from cmpsp_ros.mpsp.jit import ProgressLine, allocation_free, compilations, progress, watch
from cmpsp_ros.mpsp.jit.cache import WAITING


@pytest.fixture
def kernels(folder, module):
    """Two kernels of which one calls the other, and one that cannot be compiled."""
    source = (
        '@allocation_free\ndef inner(x):\n    return x * x\n'
        '@allocation_free\ndef outer(x):\n    return inner(x) + 1\n'
        '@allocation_free\ndef wrong(x):\n    return x.nowhere\n'
    )
    return lambda: module(source, allocation_free=allocation_free)


def test_outermost_kernels_are_reported_and_all_are_named(kernels):
    told, made = [], kernels()

    with compilations(told.append) as names:
        assert made.outer(2) == 5
        assert made.outer(2.0) == 5.0
        assert made.outer(3) == 10
        assert numba.njit(lambda x: x)(1) == 1
        with pytest.raises(numba.TypingError):
            made.wrong(1)
    assert told == ['outer', 'outer', 'wrong']
    assert names == ['outer', 'inner'] * 2 + ['wrong']
    with compilations(told.append) as names:
        assert kernels().outer(2) == 5
    kernels().inner(1 + 0j)
    assert (names, len(told)) == ([], 3)


def test_waiting_for_another_process_is_reported(kernels):
    waited = []
    with (
        compilations(wait=waited.append),
        numba.core.event.trigger_event(WAITING, {'dispatcher': kernels().outer}),
    ):
        pass
    assert waited == ['outer']


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_a_terminal_has_one_line_that_is_empty_in_the_end(kernels, monkeypatch):
    terminal = Terminal()
    monkeypatch.setattr(watch.sys, 'stderr', terminal)
    with progress(4):
        kernels().outer(1)
    bar = '[#####...............]'
    text = 'Compiling kernels (once): 1 of about 4: outer'
    assert terminal.getvalue() == f'\r\x1b[K{bar} {text}\r\x1b[K'


def test_elsewhere_there_is_a_line_every_five_seconds(monkeypatch):
    monkeypatch.setattr(watch.sys, 'stderr', io.StringIO())
    times = iter([0.0, 4.9, 5.0, 20.0])
    line = ProgressLine(3, clock=lambda: next(times))
    for count, name in enumerate('abcd', start=1):
        line.show(count, name)
    line.close()
    assert watch.sys.stderr.getvalue().splitlines() == [
        'Compiling kernels (once): 1 of about 3: a',
        'Compiling kernels (once): 3 of about 3: c',
        'Compiling kernels (once): 4: d',  # so the expectation was wrong
    ]


def test_where_nothing_is_compiled_nothing_is_said(kernels):
    kernels().outer(1)
    said = []
    with progress(say=said.append):
        kernels().outer(1)
    assert said == []
