"""Figures of a run, which repeat bit for bit, and the file of them.

Runs are added to it as they finish, so an interruption loses no finished run.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, fields
from enum import StrEnum
from functools import cache
from pathlib import Path
from typing import Any, Final

import cmpsp_ros
from cmpsp_ros.studies.common import StudyError, disk_errors
from cmpsp_ros.studies.monte_carlo.contacts import Contact, CrowdOutcome
from cmpsp_ros.studies.monte_carlo.study import Study


class RunVerdict(StrEnum):
    """The class of a run; the first that applies."""

    EXCEPTION = 'exception'
    NOT_FINITE = 'command not finite'
    TOO_FAST = 'command above the wheel limit'
    OVER_LIMIT = 'command changed or steered too much'
    LEFT_ROAD = 'left the road'
    TOUCHED = 'touched an obstacle'
    DROVE_INTO = 'drove into a person'
    ARRIVED = 'arrived'
    STOPPED = 'clear, but stopped on the way'
    TOO_FAR = 'clear, but no robot could arrive in time'
    MISSED = 'clear, but missed the goal'


# Verdicts that ask for no explanation.
HARMLESS = frozenset({RunVerdict.ARRIVED, RunVerdict.TOO_FAR})


@dataclass(frozen=True)
class StudyOutcome:
    """Figures of one run."""

    number: int  # of the run in its study
    miss: float  # distance from the goal at the final time [m]
    # Least clearance of the true path from the road's edges, also between samples and until the
    # robot is at rest, less its radius [m].
    road_clearance: float
    obstacle_clearance: float | None  # the same from obstacles; None without any
    began_outside: bool  # true if the start itself was not clear
    max_wheel_speed: float  # maximum wheel speed commanded [rad/s]
    too_fast: int  # commands above the wheel limit
    over_limit: int  # commands beyond a limit of acceleration, or of a steering angle or its rate
    not_finite: int  # commands that were not finite
    # nominal, elastic, previous_plan: Control steps at these fallback levels.
    nominal: int
    elastic: int
    previous_plan: int
    stop: int  # the same, without stops after the final time
    trouble: str  # reason of the first step at the worst fallback level; empty if that is nominal
    trouble_time: float | None  # time of that step [s]; None without trouble
    exception: str  # type and text of an exception of the law; empty if there was none
    shortest_way: float  # length of the shortest path from start to goal, ignoring obstacles [m]
    farthest: float  # distance that the robot can drive until the final time at its wheel limit [m]
    obstacles: int  # number on the road
    # x, y: At control instants and the final time [m].
    x: tuple[float, ...]
    y: tuple[float, ...]
    time: float  # the final time, possibly postponed [s]
    # Length of the shortest clear path by that time, as a part of the nominal speed; None without a
    # map.
    pace: float | None = None
    # Time until it came within the tolerance, by that of the planned path at the speed of the
    # score; None in studies without one.
    slowness: float | None = None
    told_error: float | None = None  # error of the delay given to the law [s]; None if it is exact
    crowd: CrowdOutcome | None = None  # figures among people; None without

    @property
    def clearance(self) -> float:
        """Minimum clearance from anything [m]."""
        if self.obstacle_clearance is None:
            return self.road_clearance
        return min(self.road_clearance, self.obstacle_clearance)

    @property
    def left_road(self) -> bool:
        """True if the path cut an edge; NaN counts as a cut."""
        return not self.road_clearance >= 0.0

    @property
    def touched(self) -> bool:
        """True if the path cut an obstacle; NaN counts as a cut."""
        return self.obstacle_clearance is not None and not self.obstacle_clearance >= 0.0

    @property
    def out_of_reach(self) -> bool:
        """True if even the shortest path is longer than the robot can drive in time."""
        return self.shortest_way > self.farthest

    def score(self, tolerance: float) -> float:
        """Score of the BARN challenge, at most 0.5; arrival is within `tolerance` [m]."""
        if self.slowness is None or self.verdict(tolerance) is not RunVerdict.ARRIVED:
            return 0.0
        return 1.0 / min(max(self.slowness, 2.0), 8.0)

    def verdict(self, tolerance: float) -> RunVerdict:
        """The first verdict that applies; a miss of `tolerance` [m] at most has arrived."""
        tests = {
            RunVerdict.EXCEPTION: bool(self.exception),
            RunVerdict.NOT_FINITE: self.not_finite > 0,
            RunVerdict.TOO_FAST: self.too_fast > 0,
            RunVerdict.OVER_LIMIT: self.over_limit > 0,
            RunVerdict.LEFT_ROAD: self.left_road,
            RunVerdict.TOUCHED: self.touched,
            RunVerdict.DROVE_INTO: bool(self.crowd and self.crowd.active),
            RunVerdict.ARRIVED: self.miss <= tolerance,
            RunVerdict.STOPPED: self.stop > 0,
            RunVerdict.TOO_FAR: self.out_of_reach,
        }
        return next((verdict for verdict, holds in tests.items() if holds), RunVerdict.MISSED)

    def failed(self, tolerance: float) -> bool:
        """True if the run asks for an explanation."""
        return self.verdict(tolerance) not in HARMLESS

    def to_json(self) -> str:
        """One line; floats read back bit for bit."""
        return json.dumps(asdict(self))

    @classmethod
    def from_values(cls, values: Mapping[str, Any]) -> StudyOutcome:
        """The outcome of these values, as JSON has them."""
        named = {each.name: values[each.name] for each in fields(cls)}
        named |= {'x': tuple(named['x']), 'y': tuple(named['y'])}
        if named['crowd'] is not None:
            met = tuple(Contact(**each) for each in named['crowd']['contacts'])
            named['crowd'] = CrowdOutcome(**{**named['crowd'], 'contacts': met})
        return cls(**named)


NAME: Final = 'runs.jsonl'

# Packages that affect the outcome of a run.
HASHED_PACKAGES: Final = (
    *('mpsp', 'robots', 'world', 'sensing', 'guidance', 'simulator', 'parameters'),
    'studies/monte_carlo',
)

_READ_WRITE: Final = 0o644


def open_results_log(folder: Path, study: Study) -> dict[int, StudyOutcome]:
    """Begin a study in a folder, or continue the one there; its outcomes so far, by number."""
    head = {
        'code': digest(),
        'study': study.name,
        'seed': study.seed,
        'robot': study.robot,
        'scene': study.scene,
        'told': study.told,
        'seen': study.seen,
        'obstacles': study.most_obstacles,
        'parameters': study.values(),
    }
    path = folder / NAME
    with disk_errors(folder):
        if not path.exists():
            if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
                wanted = f'a new or empty folder, or one with the {NAME} of this study'
                raise StudyError(f'{folder}: found something else there, wanted {wanted}')
            folder.mkdir(parents=True, exist_ok=True)
            _append(path, json.dumps(head))
            return {}
        lines = path.read_text(encoding='utf-8', errors='replace').splitlines()
    values = []
    for line in lines:
        # A truncated line is an unfinished run.
        with suppress(ValueError):
            values.append(json.loads(line))
    values = [each for each in values if isinstance(each, dict)]
    found = values[0] if values else {}
    if found != json.loads(json.dumps(head)):
        differing = [key for key in head if found.get(key) != head[key]]
        wanted = 'the same, or another folder'
        raise StudyError(
            f'{path}: found other {", ".join(differing) or "content"}, wanted {wanted}'
        )
    done = {}
    for each in values[1:]:
        with suppress(KeyError, TypeError):
            outcome = StudyOutcome.from_values(each)
            done[outcome.number] = outcome
    return done


def append(folder: Path, outcome: StudyOutcome) -> None:
    """Add a finished run, from any process."""
    _append(folder / NAME, outcome.to_json())


@cache
def digest() -> str:
    """Hash of all code that outcomes depend on: one study must not mix runs of different code."""
    root = Path(cmpsp_ros.__file__).parent
    digest = hashlib.sha256()
    for package in HASHED_PACKAGES:
        for path in sorted((root / package).rglob('*.py')):
            digest.update(f'{path.relative_to(root)}\0'.encode() + path.read_bytes() + b'\0')
    return digest.hexdigest()[:16]


def _append(path: Path, line: str) -> None:
    # One call of the system: neither a kill nor another process comes between. The line break in
    # front separates this line from one truncated by a power cut.
    file = os.open(path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, _READ_WRITE)
    try:
        os.write(file, f'\n{line}\n'.encode())
    finally:
        os.close(file)
