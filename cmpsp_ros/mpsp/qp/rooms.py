"""Memory of solvers, kept from one program to the next: making it takes longer than solving."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Generic, TypeVar

from cmpsp_ros.mpsp.problem import Dimensions

_Room = TypeVar('_Room')


class Rooms(Generic[_Room]):
    """Rooms of one kind, for programs of any sizes."""

    def __init__(self, make: Callable[[int, int, int, int, int], _Room]) -> None:
        """Take what makes a room for a horizon, states, controls, outputs and path rows."""
        self._make = make
        self._free: defaultdict[Dimensions, list[_Room]] = defaultdict(list)

    @contextmanager
    def of(self, size: Dimensions) -> Iterator[_Room]:
        """A room that nobody else uses."""
        free = self._free[size]
        try:
            room = free.pop()
        except IndexError:
            room = self._make(size.horizon, size.state, size.control, size.output, size.path)
        yield room
        free.append(room)
