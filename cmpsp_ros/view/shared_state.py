"""The state shown at present, written by one thread and read by many.

Browsers poll for updates. A slow one skips states, so it never lags, and nothing is queued for it.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

LONGEST: Final = 20_000
"""Rows of a series; one that is full begins again."""


@dataclass(frozen=True)
class ClientState:
    """The state that a browser already has: numbers of its course and run, rows of each series."""

    course: int = -1
    run: int = -1
    rows: dict[str, int] = field(default_factory=dict)


class SharedState:
    """The latest value of everything, and time series of the present run."""

    def __init__(self, series: Sequence[str]) -> None:
        """Start empty."""
        self._lock = threading.Lock()
        self._latest: dict[str, Any] = {}
        self._course: Any = None
        self._course_number = 0
        self._run = 0
        self._series: dict[str, list[list[Any]]] = {name: [] for name in series}
        self._received: float | None = None

    def show(self, name: str, value: Any) -> None:
        """Replace the value of a name."""
        with self._lock:
            self._latest[name] = _plain(value)

    def show_course(self, course: Any) -> None:
        """Replace the static part: it is large, and sent to each browser once."""
        with self._lock:
            self._course, self._course_number = _plain(course), self._course_number + 1

    def add(self, series: str, row: Sequence[Any]) -> None:
        """Add a row to a series."""
        with self._lock:
            rows = self._series[series]
            if len(rows) >= LONGEST:
                self._clear()
            rows.append(_plain(row))

    def begin(self) -> None:
        """Begin another run: all series are empty."""
        with self._lock:
            self._clear()

    def alive(self) -> None:
        """Note that something was received now."""
        with self._lock:
            self._received = time.monotonic()

    def updates(self, known: ClientState) -> dict[str, Any]:
        """Everything that a browser does not have, as plain values for JSON."""
        with self._lock:
            same = known.run == self._run
            first = {name: known.rows.get(name, 0) if same else 0 for name in self._series}
            updates: dict[str, Any] = {
                **self._latest,
                'course_number': self._course_number,
                'run': self._run,
                'first': first,
                'series': {name: rows[first[name] :] for name, rows in self._series.items()},
                'silence': None if self._received is None else time.monotonic() - self._received,
            }
            if known.course != self._course_number:
                updates['course'] = self._course
            return updates

    def _clear(self) -> None:
        self._run += 1
        for rows in self._series.values():
            rows.clear()


def _plain(value: Any) -> Any:
    """A value for JSON: NaN and infinity become null."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(each) for each in value]
    return value
