"""The file that runs are added to as they finish, so an interruption loses no finished run."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any, Final

import cmpsp_ros
from cmpsp_ros.studies.common import StudyError
from cmpsp_ros.studies.monte_carlo.outcome import StudyOutcome
from cmpsp_ros.studies.monte_carlo.study import Study

NAME: Final = 'runs.jsonl'

HASHED_PACKAGES: Final = (
    *('mpsp', 'robots', 'world', 'sensing', 'guidance', 'simulator', 'parameters'),
    'studies/monte_carlo',
)
"""Packages that affect the outcome of a run."""

_READ_WRITE: Final = 0o644


def open_results_log(folder: Path, study: Study) -> dict[int, StudyOutcome]:
    """Begin a study in a folder, or continue the one that is there.

    Returns:
        The outcomes that are there, by number.
    """
    head = _head(study)
    path = folder / NAME
    try:
        if not path.exists():
            if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
                wanted = f'a new or empty folder, or one with the {NAME} of this study'
                raise StudyError(f'{folder}: found something else there, wanted {wanted}')
            folder.mkdir(parents=True, exist_ok=True)
            _append(path, json.dumps(head))
            return {}
        lines = path.read_text(encoding='utf-8', errors='replace').splitlines()
    except OSError as error:
        raise StudyError(f'{folder}: {error.strerror or error}') from error
    values = list(_values(lines))
    found = values[0] if values else {}
    if found != json.loads(json.dumps(head)):
        differing = [key for key in head if found.get(key) != head[key]]
        wanted = 'the same, or another folder'
        raise StudyError(
            f'{path}: found other {", ".join(differing) or "content"}, wanted {wanted}'
        )
    return {each.number: each for each in _outcomes(values[1:])}


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


def _head(study: Study) -> dict[str, Any]:
    return {
        'code': digest(),
        'study': study.name,
        'seed': study.seed,
        'robot': study.robot,
        'scene': study.scene,
        'told': study.told,
        'obstacles': study.most_obstacles,
        'parameters': study.values(),
    }


def _values(lines: list[str]) -> Iterator[dict[str, Any]]:
    """Whole lines; a truncated one is an unfinished run."""
    for line in lines:
        try:
            value = json.loads(line)
        except ValueError:
            continue
        if isinstance(value, dict):
            yield value


def _outcomes(values: list[dict[str, Any]]) -> Iterator[StudyOutcome]:
    for each in values:
        try:
            yield StudyOutcome.from_values(each)
        except (KeyError, TypeError):
            continue
