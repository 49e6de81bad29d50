"""Quality of tracks by a laser scanner on a scripted robot among people, without guidance.

`python -m benchmarks.people_tracks` prints identity switches (all, and those of people who were out
of sight for 2 s at most), coverage, errors and times in two scenes with 4, 8 and 12 people;
`python -m benchmarks.people_tracks 100` the false tracks of as many minutes in furnished rooms
without people.
"""

import math
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Final, NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment

from benchmarks.common import Table, collector_off
from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.cli import console
from cmpsp_ros.robots.motion import arc_ends
from cmpsp_ros.sensing import Sensor, Sight, SightSettings, Surroundings, Track
from cmpsp_ros.simulator import People, PeopleSettings, Walker, cast, discs_of, edges_of
from cmpsp_ros.studies.monte_carlo import Study
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.obstacles import Shape
from cmpsp_ros.world.roads import OpenFloor

SCENES: Final = ('hall', 'crossing')
COUNTS: Final = (4, 8, 12)
TWISTS: Final = {'stands': (0.0, 0.0), 'circles': (0.3, 0.5)}
MISSED: Final = (0.0, 0.3)

# Scans of a run, time between two [ns], and steps of people in it.
_SCANS, _PERIOD, _STEPS = 600, 100_000_000, 5
_REACH: Final = 12.0
_SENSOR: Final = Sensor('front', reach=_REACH)
_ANGLES: Final = np.linspace(-0.75 * math.pi, 0.75 * math.pi, 720)
_STDDEV: Final = 0.01
_ODOMETRY: Final = np.array([0.005, 0.005, math.radians(0.3)])
_ROBOT, _BODY, _FROM_WALL = 0.35, 0.25, 0.1
_SPEEDS: Final = 0.3, 1.6
_TURN: Final = 1.0  # rate at which the robot turns into a new direction [rad/s]
_MOVES: Final = 0.2  # speed from which somebody has to be tracked [m/s]
_BRIEFLY: Final = 20  # scans out of sight after which somebody may be taken for somebody else
_SHOWN: Final = 5  # beams on somebody who is visible
_NEAR: Final = 0.6  # distance of a track and the person whom it shows [m]
_FAR: Final = 1.0  # distance of a track that shows nobody from everybody [m]
_CERTAIN: Final = 3.0


class Seen(NamedTuple):
    """One scan, and what is true then."""

    sight: Sight  # the scan
    pose: Array  # pose of the robot by odometry, shape ``(3,)`` [m, m, rad]
    people: Array  # centre, velocity and radius of each, shape ``(P, 5)`` [m, m/s, m]
    beams: IntArray  # beams that have hit each, shape ``(P,)``


def crowd(
    scene: str, count: int, twist: tuple[float, float], missed: float, seed: int = 1
) -> Iterator[Seen]:
    """Scans of a robot that drives a circle among people of whom half look at no robot."""
    walls = Study('people', scene=scene).run(0).scenario.obstacles
    begin = (6.0, 3.0 if scene == 'hall' else 6.0, 0.0)
    random = np.random.default_rng([seed, count])
    people = _people(walls, _walkers(random, walls, begin[:2], count))
    noise = _ODOMETRY if missed else np.zeros(3)
    for k in range(_SCANS):
        arc = np.array([begin]), np.array([twist]), np.array([k * _PERIOD * 1e-9])
        yield _scan(random, walls, people, k * _PERIOD, arc_ends(*arc)[0], missed, noise)


def static_room(number: int, missed: float) -> Iterator[Seen]:
    """Scans of a robot that drives about in a furnished room without people."""
    scenario = Study('sight').run(number).scenario
    walls, (x, y, heading) = scenario.obstacles, scenario.pose
    random = np.random.default_rng(number)
    robot = _people(walls, [Walker('robot', (x, y), 'random', speed=0.6, radius=_ROBOT)])
    nobody = _people(walls, [])
    for k in range(_SCANS):
        _walk(robot, k * _PERIOD, np.full((1, 2), 1e6))
        x, y, vx, vy, _ = robot.at(k * _PERIOD)[0].tolist()
        turn = math.remainder(math.atan2(vy, vx) - heading, math.tau) if vx or vy else 0.0
        heading += min(max(turn, -_TURN * _PERIOD * 1e-9), _TURN * _PERIOD * 1e-9)
        pose = np.array([x, y, heading])
        yield _scan(random, walls, nobody, k * _PERIOD, pose, missed, _ODOMETRY)


def _walkers(
    random: np.random.Generator, walls: Sequence[Shape], robot: tuple[float, float], count: int
) -> list[Walker]:
    """People in places clear of walls, of each other, and of the robot."""
    space = FreeSpace.of(OpenFloor(), walls, _BODY + _FROM_WALL)
    corners = np.vstack([each.corners for each in walls])
    walkers = list[Walker]()
    while len(walkers) < count:
        x, y = random.uniform(corners.min(axis=0), corners.max(axis=0)).tolist()
        heading, speed = float(random.uniform(-math.pi, math.pi)), float(random.uniform(*_SPEEDS))
        clear = space.at(np.array([[x, y, 0.0]]))[:, 2:].min() > 0.0
        seen = np.empty(1)
        cast(seen, np.array([[*robot, math.atan2(y - robot[1], x - robot[0])]]), np.zeros(1),
             edges_of(walls), discs_of(walls))  # fmt: skip
        # In sight of the robot: of a crossing the corners are no place to walk.
        inside = seen[0] > math.dist((x, y), robot)
        apart = min(math.dist((x, y), each) for each in [robot, *(w.position for w in walkers)])
        if clear and inside and apart > 2.0 * _BODY:
            each = Walker(f'p{len(walkers)}', (x, y), 'random', heading=heading, speed=speed)
            straight = replace(each, motion='straight', gives_way=False)
            walkers.append(each if len(walkers) % 2 else straight)
    return walkers


def _people(walls: Sequence[Shape], walkers: Sequence[Walker]) -> People:
    people = People(PeopleSettings(tuple(walkers)), edges_of(walls), discs_of(walls))
    people.begin(0)
    return people


def _walk(people: People, stamp: int, robot: Array) -> None:
    for moment in range(max(stamp - _PERIOD, 0), stamp + 1, _PERIOD // _STEPS):
        people.advance(moment, robot, _ROBOT)


def _scan(
    random: np.random.Generator,
    walls: Sequence[Shape],
    people: People,
    stamp: int,
    pose: Array,
    missed: float,
    noise: Array,
) -> Seen:
    """Scan at a time [ns] and a pose ``(3,)``, with the pose of noisy odometry."""
    _walk(people, stamp, pose[None, :2])
    count, bodies = len(_ANGLES), people.at(stamp)
    rays = np.column_stack([np.tile(pose[:2], (count, 1)), pose[2] + _ANGLES])
    ranges, edges, discs = np.empty((1 + len(bodies), count)), edges_of(walls), discs_of(walls)
    cast(ranges[0], rays, np.zeros(count), edges, np.vstack([discs, bodies]))
    for one, body in zip(ranges[1:], bodies, strict=True):
        cast(one, rays, np.zeros(count), edges[:0], body[None])
    nearest = ranges[0] + _STDDEV * random.standard_normal(count)
    hits = (ranges[0] < _REACH) & (random.random(count) >= missed)
    lengths = np.where(hits, nearest, _REACH)[:, None]
    ends = lengths * np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)])
    stamps = np.full(count, stamp)
    sight = Sight(_SENSOR, stamp, stamps, np.zeros((count, 2)), ends, hits, is_sweep=True)
    shown = ((ranges[1:] == ranges[0]) & hits).sum(axis=1)
    return Seen(sight, pose + noise * random.standard_normal(3), bodies, shown)


class Score:
    """Comparison of tracks with people, scan by scan."""

    def __init__(self) -> None:
        """Start without scans."""
        self._shown, self._hidden = dict[int, int](), dict[int, int]()
        self._proved, self._all = set[int](), set[int]()
        self.switches = self.sudden = self.visible = self.covered = self.astray = self.scans = 0
        self.errors = list[tuple[float, float, float, float]]()
        self.times = list[float]()

    def add(self, seen: Seen, tracks: Sequence[Track], took: float) -> None:
        """Compare the tracks at a scan; they took so long [ms]."""
        self.scans, people = self.scans + 1, seen.people
        self.times.append(took)
        states = np.array([(t.x, t.y, t.vx, t.vy) for t in tracks]).reshape(-1, 4)
        away = np.hypot(*(states[:, None, :2] - people[:, :2]).transpose(2, 0, 1))
        self._all |= {each.id for each in tracks}
        near = away.min(axis=1, initial=math.inf)
        self._proved |= {t.id for t, each in zip(tracks, near, strict=True) if each <= _FAR}
        self.astray += int((near > _FAR).sum())
        # Whoever had a track keeps it while it is near: else two who pass would seem to swap.
        kept = np.array([[self._shown.get(p) == t.id for p in range(len(people))] for t in tracks])
        costs = np.where(away <= _NEAR, away - kept.reshape(away.shape), 1e3)
        matched = {j: i for i, j in zip(*linear_sum_assignment(costs), strict=True)
                   if costs[i, j] < 1e3}  # fmt: skip
        for person in np.flatnonzero(seen.beams < _SHOWN).tolist():
            self._hidden[person] = self._hidden.get(person, 0) + 1
        moves = np.hypot(people[:, 2], people[:, 3]) >= _MOVES
        for person in np.flatnonzero(moves & (seen.beams >= _SHOWN)).tolist():
            self.visible += 1
            if person not in matched:
                continue
            self.covered, k = self.covered + 1, matched[person]
            track, off = tracks[k], states[k] - people[person, :4]
            is_other = self._shown.get(person, track.id) != track.id
            self.switches += is_other
            self.sudden += is_other and self._hidden.get(person, 0) <= _BRIEFLY
            self._hidden[person] = 0
            self._shown[person] = track.id
            numbers = math.hypot(*off[:2]), math.hypot(*off[2:])
            self.errors.append((*numbers, track.position_stddev, track.velocity_stddev))

    @property
    def identities(self) -> int:
        """The number of tracks."""
        return len(self._all)

    @property
    def false(self) -> int:
        """The number of tracks that have never shown anybody."""
        return len(self._all - self._proved)


def judged(scans: Iterator[Seen]) -> Score:
    """Tracks of a run, compared with the truth."""
    score = Score()
    # The grid is no part of this: a small one leaves the time to the tracks.
    surroundings = Surroundings(SightSettings((_SENSOR,), size=1.0, resolution=1.0), _ROBOT)
    with collector_off():
        for seen in scans:
            surroundings.add(seen.sight)
            began = time.thread_time_ns()
            surroundings.update(seen.sight.stamp, seen.pose)
            sighting = surroundings.at(seen.sight.stamp, seen.pose)
            took = 1e-6 * (time.thread_time_ns() - began)
            score.add(seen, () if sighting is None else sighting.tracks, took)
    return score


COLUMNS: Final = ('scene', 'robot', 'missed', 'people', 'switches / person min', 'sudden', 'tracks',
    'covered [%]', 'position [m]', 'velocity [m/s]', 'p95', 'NEES place', 'NEES velocity',
    'beyond 3 sigma [%]', 'astray [%]', 'false', 'time [ms]', 'p99')  # fmt: skip


def row(score: Score) -> tuple[str, ...]:
    """Numbers of a run, from the fifth column on."""
    minutes = max(score.visible, 1) * _PERIOD * 1e-9 / 60.0
    place, velocity, place_stddev, velocity_stddev = np.array(score.errors).reshape(-1, 4).T
    # Two coordinates: of a consistent filter the mean is 2.
    nees = (place / place_stddev) ** 2, (velocity / velocity_stddev) ** 2
    beyond = (nees[0] > _CERTAIN**2) | (nees[1] > _CERTAIN**2)
    numbers = (
        score.switches / minutes, score.sudden / minutes, score.identities,
        100.0 * score.covered / max(score.visible, 1),
        np.median(place), np.median(velocity), np.percentile(velocity, 95.0),
        nees[0].mean(), nees[1].mean(), 100.0 * beyond.mean(),
        100.0 * score.astray / max(len(score.errors), 1), score.false,
        np.median(score.times), np.percentile(score.times, 99.0),
    )  # fmt: skip
    forms = '.2f .2f d .1f .3f .3f .2f .1f .1f .1f .1f d .2f .2f'.split()  # noqa: SIM905
    return tuple(format(each, form) for each, form in zip(numbers, forms, strict=True))


def main(arguments: Sequence[str]) -> None:
    """Print the table of all crowds, or the false tracks of so many minutes without people."""
    if arguments:
        minutes, found = int(arguments[0]), 0
        for k in range(minutes):
            score = judged(static_room(k, MISSED[k % 2]))
            found += score.identities
            if score.identities:
                console().print(f'room {k}: {score.identities} tracks in {score.astray} scans')
        console().print(f'{found} false tracks in {minutes} minutes')
        return
    rows = [
        (
            scene,
            robot,
            f'{missed:.0%}',
            str(count),
            *row(judged(crowd(scene, count, twist, missed))),
        )
        for scene in SCENES
        for robot, twist in TWISTS.items()
        for missed in MISSED
        for count in COUNTS
    ]
    console().print(Table('Tracks of people', COLUMNS, rows, words=3).markdown())


if __name__ == '__main__':
    main(sys.argv[1:])
