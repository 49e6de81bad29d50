"""Before a node is active compilations are told of; while it is active they are errors."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from cmpsp_ros.mpsp.jit.compiled import compiled
from cmpsp_ros.nodes.guidance import timing
from cmpsp_ros.nodes.guidance.diagnostics import report_on
from cmpsp_ros.nodes.guidance.lifecycle import ACTIVE
from cmpsp_ros.nodes.guidance.timing import LateCompilations, prepare_aloud


@pytest.fixture(autouse=True)
def nothing_is_kept(monkeypatch):
    monkeypatch.setattr('cmpsp_ros.mpsp.jit.compiled.kernel_folder', lambda: None)


def kernel():
    return compiled(lambda x: x + 1)


def report(late):
    loop = SimpleNamespace(
        decision=None,
        connections={},
        warnings=list,
        waiting='',
        road=SimpleNamespace(waits=False, refusal=''),
        map=SimpleNamespace(refusal=''),
        odometry_age=None,
        gate=SimpleNamespace(counts={}),
        times=SimpleNamespace(values=dict),
    )
    found = report_on(ACTIVE, '', loop, (), late.errors())
    return found.level, found.message


def test_a_kernel_compiled_while_active_is_an_error(fault):
    late, early = LateCompilations(), kernel()
    early(1)
    late.begin()
    early(2)
    assert report(late) == (DiagnosticStatus.WARN, 'Waiting for odometry.')
    early(2.0)
    level, said = report(late)
    assert said.endswith('kernel.<locals>.<lambda>.')
    fault.assert_said('—', level[0], said)
    late.end()
    kernel()(1j)
    assert report(late) == (level, said)
    late.begin()
    assert report(late)[0] == DiagnosticStatus.WARN
    late.end()


def test_what_is_compiled_before_is_told_of_with_names_and_how_many(monkeypatch):
    lines = []
    monkeypatch.setattr(timing, 'prepare', lambda settings: settings(1))
    prepare_aloud(kernel(), SimpleNamespace(info=lines.append))
    assert lines[:2] == [
        'compiling, once; `cmpsp warmup` does it beforehand',
        'Compiling kernels (once): 1: kernel.<locals>.<lambda>',
    ]
    assert lines[2].startswith('compiled 1 kernels in ')
    del lines[:]
    prepare_aloud(lambda _: None, SimpleNamespace(info=lines.append))
    assert lines == []
