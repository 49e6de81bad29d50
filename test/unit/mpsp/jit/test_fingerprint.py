"""A fingerprint changes with all that machine code depends on, and with nothing else."""

import pytest

from cmpsp_ros.mpsp.jit import allocation_free
from cmpsp_ros.mpsp.jit.fingerprint import fingerprint

SOURCE = """
from enum import IntEnum
from typing import NamedTuple
import numba, numpy as np
from numba.extending import intrinsic, register_jitable
from cmpsp_ros.mpsp.jit import allocation_free, inlined

GAIN = 2.0
SIZES = (1, (2, np.int32(3)), {'a', 'b'})
KIND = np.dtype('float64')
TABLE = np.array([1.0, 2.0])

class Status(IntEnum):
    SOLVED = 7

class Data(NamedTuple):
    slope: float

def explain():
    return 'it went wrong'

@intrinsic
def plus(typing_context, x):
    def generate(context, builder, signature, values):
        return builder.fadd(values[0], values[0])
    return x(x), generate

@register_jitable
def helper(x):
    return x + 20

@allocation_free
def innermost(x):
    return x * GAIN

@allocation_free
def inner(x, by=3):
    return innermost(x) + by

def factory(n):
    return lambda x: x + n

closed = allocation_free(factory(30))

@allocation_free
def kernel(x):
    'What it does.'
    total = np.zeros(40, KIND)
    if x > 1000000:
        raise ValueError('too large')
    data = Data(slope=x)  # named tuple
    for k in range(len(SIZES)):
        total[0] += inner(x) + plus(x) + helper(x) + closed(x) + TABLE[k]
    return total[0] + Status.SOLVED + data.slope + units.METRE + None
"""
UNITS = 'METRE = 50.0\nFOOT = 0.3\nprint\n'


@pytest.fixture
def make(module):
    """The fingerprint of `kernel`, with replacements in the source."""

    def make_kernel(*changes, units=UNITS):
        source = SOURCE
        for old, new in changes:
            assert source.count(old) >= 1
            source = source.replace(old, new)
        return fingerprint(module(source, units=module(units, 'units')).kernel)

    return make_kernel


@pytest.mark.parametrize(
    ('old', 'new'),
    [
        ('# named tuple', ''),
        ("'What it does.'", "'What it really does.'"),
        ("    'What it does.'\n", ''),
        ('GAIN = 2.0\n', '\n\n\nGAIN = 2.0\nOTHER = 1\n'),
        ('it went wrong', 'the matrix is singular'),
        ('kernel(x):\n', 'kernel(x: float) -> float:\n'),
        ('total', 'result'),
        ("{'a', 'b'}", "{'b', 'a'}"),
    ],
)
def test_what_leaves_the_machine_code_alone(make, old, new):
    assert make() == make((old, new))


@pytest.mark.parametrize(
    ('old', 'new'),
    [
        ('GAIN = 2.0', 'GAIN = 2.5'),
        ('GAIN = 2.0', 'GAIN = 2'),
        ('GAIN = 2.0', 'GAIN = np.float64(2.0)'),
        ('GAIN = 2.0', 'GAIN = -0.0'),
        ('(2, np.int32(3))', '(2, np.int32(4))'),
        ('(2, np.int32(3))', '(2, np.int64(3))'),
        ("{'a', 'b'}", "{'a', 'c'}"),
        ("'float64'", "'float32'"),
        ('[1.0, 2.0]', '[1.0, 3.0]'),
        ('SOLVED = 7', 'SOLVED = 8'),
        ('slope', 'rise'),
        ('builder.fadd', 'builder.fsub'),
        ('x + 20', 'x + 21'),
        ('x * GAIN', 'GAIN / x'),
        ('by=3', 'by=4'),
        ('factory(30)', 'factory(31)'),
        ('closed = allocation_free(', 'closed = inlined('),
        ('zeros(40', 'zeros(41'),
        ('too large', 'too big'),
        ('kernel(x)', 'kernel(x, y=0)'),
    ],
)
def test_what_changes_the_machine_code(make, old, new):
    assert make() != make((old, new))


def test_of_other_modules_only_what_is_referred_to_counts(make):
    assert make() == make(units=UNITS.replace('0.3', '0.4'))
    assert make() != make(units=UNITS.replace('50.0', '60.0'))


def test_many_constants_are_told_apart(module):
    lines = ''.join(f'    y += x * {k}.5\n' for k in range(600))
    source = f'def kernel(x):\n    y = 0\n{lines}    return y\n'
    one = fingerprint(module(source).kernel)
    assert fingerprint(module(source.replace('(x):\n', '(x):\n    "Doc."\n')).kernel) == one
    assert fingerprint(module(source.replace('599.5', '598.5')).kernel) != one


def test_functions_that_call_each_other_have_one(module):
    source = 'even = lambda n: n == 0 or odd(n - 1)\nodd = lambda n: n and even(n - 1)'
    first, second = module(source), module(source.replace('n and', 'n or'))
    assert fingerprint(first.even) == fingerprint(module(source).even)
    assert len({fingerprint(each) for each in (first.even, first.odd, second.even)}) == 3


def test_a_function_that_is_defined_later_or_anew_is_noticed(module):
    made = module('def kernel(x):\n    return scale(x)\n')
    digests = [fingerprint(made.kernel)]
    for factor in (2, 3):
        exec(f'def scale(x):\n    return {factor} * x', vars(made))
        digests.append(fingerprint(made.kernel))
    assert len(set(digests)) == 3


def test_it_is_the_same_in_every_process(run, monkeypatch):
    program = (
        f'import types\nunits = types.SimpleNamespace(METRE=1.0)\n{SOURCE}\n'
        'from cmpsp_ros.mpsp.jit.fingerprint import fingerprint\nprint(fingerprint(kernel))'
    )
    said = []
    for seed in '12':
        monkeypatch.setenv('PYTHONHASHSEED', seed)
        said += run(program)
    assert said[0] == said[1]


def test_without_a_known_content_a_kernel_is_compiled_in_every_process(module, folder):
    made = module(
        'from numba.extending import intrinsic\nlock = __import__("threading").Lock()\n'
        '@intrinsic\n'
        'def same(typing_context, x):\n'
        '    def generate(context, builder, signature, values):\n'
        '        with lock:\n            return values[0]\n'
        '    return x(x), generate\n'
        'def kernel(x):\n    return same(x) + 1\n'
    )
    with pytest.raises(TypeError, match=r'lock object .* has no content'):
        fingerprint(made.kernel)
    assert allocation_free(made.kernel)(1) == 2
    assert [*folder.glob('*.kernel')] == []
