"""Compilations are announced before a node is active, and reported as errors while it is."""

import secrets
from functools import partial
from types import SimpleNamespace

from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.nodes.guidance.timing import LateCompilations, prepare_aloud


def kernel():
    """A kernel that no cache has."""
    number = secrets.randbits(60)
    return allocation_free(lambda x: x + number)


def test_a_kernel_compiled_while_active_is_an_error_from_then_on():
    late, early = LateCompilations(), kernel()
    early(1)
    late.begin()
    early(2)
    assert late.errors() == []
    early(2.0)
    (said,) = late.errors()
    assert said.endswith('kernel.<locals>.<lambda>.')
    late.end()
    kernel()(1j)
    assert late.errors() == [said]
    late.begin()
    assert late.errors() == []
    late.end()


def test_what_is_compiled_before_is_told_of_with_names_and_how_many():
    lines = []
    prepare_aloud(partial(kernel(), 1), SimpleNamespace(info=lines.append))
    assert lines[:2] == [
        'compiling, once; `cmpsp warmup` does it beforehand',
        'Compiling kernels (once): 1: kernel.<locals>.<lambda>',
    ]
    assert lines[2].startswith('compiled 1 kernels in ')
    del lines[:]
    prepare_aloud(lambda: None, SimpleNamespace(info=lines.append))
    assert lines == []
