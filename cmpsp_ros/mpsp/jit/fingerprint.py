"""Digest of a kernel: its bytecode and everything that it refers to.

Numba's own cache goes by the date of the file, and does not see that a function of another module
has changed which the kernel calls. Here constants and functions of other modules count; comments,
docstrings, line numbers and names of files do not. Functions registered by numba's `overload`
are not followed: they have no name in the bytecode.
"""

import dis
import hashlib
import pickle
import platform
import sys
from collections.abc import Iterator
from enum import Enum
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import Any, Final, NamedTuple
from weakref import WeakKeyDictionary

import llvmlite
import numba
import numpy as np

# Versions that machine code depends on, besides the processor.
VERSIONS: Final = (
    f'numba {numba.__version__}, llvmlite {llvmlite.__version__}, numpy {np.__version__},'
    f' {platform.python_implementation()} {platform.python_version()}'
)

_KNOWN: Final = frozenset(sys.stdlib_module_names) | {'numba', 'llvmlite', 'numpy'}
_USES_CONSTANT: Final = frozenset(dis.hasconst)
_EXTENDED: Final = dis.opmap['EXTENDED_ARG']
_PLAIN: Final = (type(None), bool, int, float, complex, str, bytes, type(Ellipsis), range, slice)


class _Node(NamedTuple):
    """One function: the values that its names stand for, a digest, and the functions among them."""

    values: list[tuple[str, Any]]
    digest: bytes
    references: list[FunctionType]


_nodes: WeakKeyDictionary[FunctionType, _Node] = WeakKeyDictionary()


def fingerprint(kernel: Any) -> str:
    """Digest of a function, compiled or not, by the present values of its names.

    Raises:
        TypeError: It refers to an object without a known content.
    """
    begin: list[FunctionType] = []
    digest = hashlib.sha256(_describe(kernel, begin).encode())
    order = {each: i for i, each in enumerate(begin)}
    for each in begin:  # grows under way; a cycle ends at what is there already
        node = _node(each)
        for reference in node.references:
            if reference not in order:
                order[reference] = len(order)
                begin.append(reference)
        digest.update(node.digest)
        digest.update(repr([order[reference] for reference in node.references]).encode())
    return digest.hexdigest()


def _node(function: FunctionType) -> _Node:
    values = list(_values(function))
    known = _nodes.get(function)
    if known is not None and len(values) == len(known.values):
        pairs = zip(values, known.values, strict=True)
        if all(a is b and name == before for (name, a), (before, b) in pairs):
            return known
    references: list[FunctionType] = []
    parts = [_describe_code(function.__code__)]
    parts += [f'{name} = {_describe(value, references)}' for name, value in values]
    digest = hashlib.sha256('\n'.join(parts).encode()).digest()
    node = _nodes[function] = _Node(values, digest, references)
    return node


def _values(function: FunctionType) -> Iterator[tuple[str, Any]]:
    """Names of a function and the values that they stand for."""
    for i, default in enumerate(function.__defaults__ or ()):
        yield f'default {i}', default
    yield from (function.__kwdefaults__ or {}).items()
    for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=True):
        try:
            value = cell.cell_contents
        except ValueError:  # not defined yet
            continue
        yield name, value
    names = list(dict.fromkeys(_names(function.__code__)))
    spaces, modules = [function.__globals__], set()
    for space in spaces:  # grows by the modules that are found
        for name in names:
            if name in space:
                value = space[name]
                yield name, value
                if isinstance(value, ModuleType) and not _is_known(value.__name__):
                    spaces += [vars(value)] * (value not in modules)
                    modules.add(value)


def _names(code: CodeType) -> Iterator[str]:
    yield from code.co_names
    for each in code.co_consts:
        if isinstance(each, CodeType):
            yield from _names(each)


def _describe_code(code: CodeType) -> str:
    """The instructions, with constants in place of their numbers: the docstring is one of those."""
    operations, arguments = code.co_code[::2], bytearray(code.co_code[1::2])
    constants = []
    for i, operation in enumerate(operations):
        if operation in _USES_CONSTANT:
            number, k = arguments[i], i
            arguments[i] = 0
            while k > 0 and operations[k - 1] == _EXTENDED:
                k -= 1
                number |= arguments[k] << 8 * (i - k)
                arguments[k] = 0
            constants.append(_describe(code.co_consts[number], []))
    # The flags beyond say how it was compiled: with annotations, with a docstring.
    flags = code.co_flags & 0xFF
    signature = code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount, flags
    parameters = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
    names = parameters, code.co_names, code.co_cellvars, code.co_freevars
    table = code.co_exceptiontable.hex()
    return f'{operations.hex()} {arguments.hex()} {table} {signature} {names} {constants}'


def _describe(value: Any, references: list[FunctionType]) -> str:
    """A value's content; functions are appended to ``references`` and looked at later."""
    if isinstance(value, (Enum, np.generic, np.ndarray, np.dtype, np.ufunc)):
        return _describe_special(value)
    if isinstance(value, _PLAIN):
        return f'{type(value).__name__} {value!r}'
    if isinstance(value, (tuple, list)):
        return f'{_describe(type(value), [])} {[_describe(each, references) for each in value]}'
    if isinstance(value, (set, frozenset)):
        return f'set {sorted(_describe(each, references) for each in value)}'
    if isinstance(value, CodeType):
        return _describe_code(value)
    if isinstance(function := getattr(value, 'py_func', None), FunctionType):
        references.append(function)
        options = sorted(getattr(value, 'targetoptions', {}).items())
        return f'compiled {[(name, _describe(each, references)) for name, each in options]}'
    if isinstance(function := getattr(value, '_defn', None), FunctionType):
        references.append(function)
        return 'intrinsic'
    if isinstance(value, type):
        members = value.__members__.values() if issubclass(value, Enum) else ()
        fields = getattr(value, '_fields', ()), [_describe(each, []) for each in members]
        return f'class {value.__module__}.{value.__qualname__} {fields}'
    if isinstance(value, ModuleType):
        return f'module {value.__name__}'
    return _describe_object(value, references)


def _describe_special(value: Any) -> str:
    """A value of an enumeration or of numpy."""
    if isinstance(value, Enum):
        return f'{type(value).__qualname__}.{value.name} {value.value!r}'
    if isinstance(value, np.ufunc):
        return f'ufunc {value.__name__}'
    if isinstance(value, np.dtype):
        return f'dtype {value.descr}'
    content = hashlib.sha256(value.tobytes()).hexdigest()
    order = getattr(value, 'flags', None)
    return f'{type(value).__name__} {value.dtype.descr} {value.shape} {order} {content}'


def _describe_object(value: Any, references: list[FunctionType]) -> str:
    module, name = getattr(value, '__module__', None), getattr(value, '__qualname__', None)
    if isinstance(value, FunctionType) and not _is_known(module or ''):
        references.append(value)
        return 'function'
    if isinstance(value, (FunctionType, BuiltinFunctionType)):
        return f'{module}.{name}'
    if isinstance(value, numba.types.Type):
        return describe_type(value)
    try:
        return f'{type(value).__qualname__} {pickle.dumps(value, protocol=4).hex()}'
    except Exception as error:
        raise TypeError(f'{value!r} has no content that a fingerprint could be made of') from error


def describe_type(kind: Any) -> str:
    """A type of numba, with all that machine code for it depends on."""
    if isinstance(kind, numba.types.Dispatcher):
        return fingerprint(kind.dispatcher)
    if not isinstance(kind, numba.types.BaseTuple):
        return str(kind)
    inside = [describe_type(each) for each in kind.types]
    if isinstance(kind, numba.types.BaseNamedTuple):
        return f'{_describe(kind.instance_class, [])} {inside}'
    return f'tuple {inside}'


def _is_known(module: str) -> bool:
    """True for a module whose content goes by a version."""
    return module.partition('.')[0] in _KNOWN
