"""One translation for records of all sizes: the sizes are put into its bitcode when it is linked.

Numba's types of records contain the sizes of their arrays, so it would translate a function anew
for each. Here it translates it once, for sizes that no program has. All that depends on them is a
number in the code: a size, a stride, an offset, or the length of a record.
"""

import re
from collections.abc import Callable, Iterable
from functools import cache
from itertools import chain
from typing import Any, Final, NamedTuple

import numpy as np
from llvmlite import binding
from numba import from_dtype, types

# Sizes ``n`` and ``r`` in the translation: prime, so that no two products of them are equal.
_STAND_INS: Final = 2003, 1009
# Whole numbers in the text of a module; others are parts of names, or lengths in types.
_NUMBER: Final = re.compile(r'(?<![\w.%@"$!#\[-])(i32 )?(\d{4,})(?![\w."])')
_SYMBOL: Final = re.compile(r'ptrtoint \(ptr @size\.(\d+) to i64\)')
_LENGTH: Final = re.compile(r'\[(\d{4,}) x')
_BY_TYPE: Final = re.compile(r'getelementptr (?:inbounds )?\[\d{4,} x [^,]+,[^,]+, i\d\d (?!0\b).*')
_LEFT: Final = re.compile(r'@size\.\d+\b(?! = extern_weak)')
_STANDS_IN: Final = re.compile(r'\b({}|{})\b'.format(*_STAND_INS))

_Layout = Callable[[int, int], np.dtype[Any]]
_layouts: Final[list[_Layout]] = []
_known: Final[dict[Any, tuple[_Layout, tuple[int, int]]]] = {}


def sized(layout: _Layout) -> _Layout:
    """Let code be shared by all records of a layout, a function of ``n`` and ``r``."""

    @cache
    def known(n: int, r: int) -> np.dtype[Any]:
        dtype = layout(n, r)
        _known[from_dtype(dtype)] = known, (n, r)
        return dtype

    _layouts.append(known)
    return known


class NotGeneralError(Exception):
    """Code that must be translated for each size, since it reaches records by their type."""


class General(NamedTuple):
    """Types of arguments with `_STAND_INS` for the sizes of records; None for no one size."""

    signature: tuple[Any, ...]
    sizes: tuple[int, int] | None


@cache
def generalised(signature: tuple[Any, ...]) -> General:
    """The types by which a function is translated, and the sizes that have been taken out."""
    found: set[tuple[int, int]] = set()
    general = tuple(_general(each, found) for each in signature)
    if len(found) != 1 or found == {_STAND_INS}:
        return General(signature, None)
    return General(general, found.pop())


def is_general(signature: Iterable[Any]) -> bool:
    """True where the code of a function may contain `_STAND_INS`."""
    return any(_STANDS_IN.search(str(each)) for each in signature)


def _general(kind: Any, found: set[tuple[int, int]]) -> Any:
    if kind in _known:
        layout, sizes = _known[kind]
        found.add(sizes)
        return from_dtype(layout(*_STAND_INS))
    if isinstance(kind, types.Array) and not isinstance(kind, types.NestedArray):
        return kind.copy(dtype=_general(kind.dtype, found))
    if isinstance(kind, types.BaseTuple):
        members = [_general(each, found) for each in kind.types]
        return types.BaseTuple.from_types(members, getattr(kind, 'instance_class', None))
    return kind


def with_symbols(text: str) -> str:
    """The text of a translated function, with symbols in place of all that depends on sizes.

    An optimiser may combine numbers, but takes the address of a symbol as it is.

    Raises:
        NotGeneralError: It does not work for all sizes.
    """
    numbers, used = _numbers(1, 1), set[str]()

    def symbol(found: re.Match[str]) -> str:
        kind, number = found.groups()
        if number not in numbers:
            return found[0]
        used.add(number)
        # Offsets in records are indices, which may be of any type.
        return f'{"i64 " if kind else ""}ptrtoint (ptr @size.{number} to i64)'

    text = _NUMBER.sub(symbol, text)
    if (found := _BY_TYPE.search(text)) is not None:
        raise NotGeneralError(found[0])
    return '\n'.join([text, *(f'@size.{each} = extern_weak global i8' for each in sorted(used))])


def with_sizes(module: Any, n: int, r: int) -> Any:
    """The module of functions `with_symbols` for ``n`` and ``r``."""
    numbers = _numbers(n, r)
    text = _SYMBOL.sub(lambda found: numbers[found[1]], str(module))
    text = _LENGTH.sub(lambda found: f'[{numbers.get(found[1], found[1])} x', text)
    if _LEFT.search(text):
        raise AssertionError(f'{module.name}: found a size that is no number')
    return binding.parse_assembly(text)


@cache
def _numbers(n: int, r: int) -> dict[str, str]:
    """Each number that stands in for another one, and that."""
    numbers: dict[str, str] = {}
    for layout in _layouts:
        pairs = (_described(from_dtype(layout(*sizes))) for sizes in (_STAND_INS, (n, r)))
        for general, own in zip(*pairs, strict=True):
            if numbers.setdefault(str(general), str(own)) != str(own):
                raise AssertionError(f'{general} stands for {numbers[str(general)]} and {own}')
    # Below this they are the same for all sizes.
    return {general: own for general, own in numbers.items() if int(general) >= min(_STAND_INS)}


def _described(record: Any) -> list[int]:
    """All numbers of a record that depend on sizes."""
    nested = [each.type for each in record.fields.values()]
    arrays = [each for each in nested if isinstance(each, types.NestedArray)]
    of_arrays = ((*each.shape, *each.strides, each.nitems) for each in arrays)
    offsets = (each.offset for each in record.fields.values())
    return [record.size, *offsets, *chain.from_iterable(of_arrays)]
