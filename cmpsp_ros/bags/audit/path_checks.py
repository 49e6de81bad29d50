"""Checks of the path: clear, feasible for the wheels, and at the goal in the end."""

import math
from collections.abc import Iterator
from itertools import chain
from operator import attrgetter
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array, BoolArray, IntArray
from cmpsp_ros.bags.audit.finding import (
    NothingMetError,
    NotJudgedError,
    Sample,
    SkippedError,
    check,
)
from cmpsp_ros.bags.audit.legs import Commands, Leg
from cmpsp_ros.bags.audit.record import EDGES, AuditRecord, Met, Sweep, path_gap
from cmpsp_ros.bags.audit.sensor_gaps import sensor_gap
from cmpsp_ros.bags.decision_record import DecisionRecord
from cmpsp_ros.bags.runs.odometry import interpolated, is_within
from cmpsp_ros.bags.runs.sensor_clearance import EXACT, driven_into
from cmpsp_ros.guidance import NANOSECONDS, GuidanceSettings
from cmpsp_ros.robots.motion import arc_ends
from cmpsp_ros.world.obstacles import ROUGHNESS
from cmpsp_ros.world.roads import project_on_path

_ROUNDING: Final = 1e-6  # rounding error of a clearance [m]
# Violation that a linearised constraint may have at a sample [m]; see `guidance.audit`.
_SAMPLE_TOLERANCE: Final = 1e-3
_ROAD: Final = ('road',)
_stamp = attrgetter('stamp')


def _clear_in_words(worst: Sample) -> str:
    source: Sweep = worst.words['source']
    radius = 0.0 if source.settings.footprint.corners else source.settings.robot_radius
    around = f'the robot (radius {radius:.3g} m)' if radius else 'the robot'
    nearest, by = worst.words['nearest'], f' (by {source.by})' if source.by else ''
    if worst.value >= 0.0:
        return f'Between samples too, {around} keeps {worst.value:.3g} m from {nearest}{by}.'
    return f'Along the path driven, {around} cuts {nearest} by {-worst.value:.3g} m{by}.'


_CLEAR: Final = {'unit': 'm', 'of_reach': True, 'good': _clear_in_words, 'bad': _clear_in_words}


def _clear(record: AuditRecord, columns: slice, *, margin: bool = False) -> Iterator[Sample]:
    """Minimum clearance by each source; a contact proven by one is not disproven by another.

    The limit is 0 or the margin in force, lower by what the source may be off.
    """
    yield Sample(math.inf, 0.0, None, -math.inf)
    for each in record.evidence:
        wanted = each.settings.safety.margin if margin else 0.0
        part = np.nan_to_num(each.clearance[:, columns], nan=-math.inf)
        if part.size:
            row, column = np.unravel_index(int(part.argmin()), part.shape)
            least, at = float(part[row, column]), int(each.stamps[row])
            words = {'source': each, 'nearest': each.names[int(column) + (columns.start or 0)]}
            short = wanted - least
            excess = short - (_ROUNDING + each.tolerance)
            yield Sample(least, wanted - each.tolerance, at, excess, rank=short, words=words)


@check('road', 'Path: inside the road', needs=_ROAD, gaps=(path_gap,), **_CLEAR)
def road(record: AuditRecord) -> Iterator[Sample]:
    """Clearance from both road edges."""
    if not any(each.settings.road.has_center_line for each in record.sweeps):
        raise SkippedError('There is no road (road.type is none).')
    yield from _clear(record, slice(0, EDGES))


def _doubtful(record: AuditRecord, worst: Sample) -> str:
    is_touched = worst.value < -_ROUNDING and worst.passes and not record.history.simulated
    return f'That is within what sensors may be off by ({EXACT} m).' if is_touched else ''


@check(
    'obstacles', 'Path: clear of obstacles', needs=('obstacles.names',),
    gaps=(_doubtful, sensor_gap, path_gap), **_CLEAR,
)  # fmt: skip
def obstacles(record: AuditRecord) -> Iterator[Sample]:
    """Clearance from all obstacles: configured, simulated and sensed."""
    if not any(each.settings.obstacles for each in record.evidence) and not any(record.seen):
        if reason := sensor_gap(record):
            raise NotJudgedError(reason)
        raise SkippedError('There is no obstacle among the parameters.')
    yield from _clear(record, slice(EDGES, None))


def _apart_in_words(worst: Sample) -> str:
    nearest, where, stood = (worst.words[key] for key in ('nearest', 'where', 'stood'))
    said = f'Between samples too, the robot keeps {worst.value:.3g} m from {nearest}{where}.'
    if not worst.passes:
        said = f'Along the path driven, the robot cuts {nearest} by {-worst.value:.3g} m.'
    return f'{said} Something moves {-stood:.3g} m into it while it stands.' if stood < 0 else said


def _apart(legs: Met, where: str) -> Iterator[Sample]:
    met = [each for some in legs for each in some]
    stood = min(float(each.clearance[each.stands].min(initial=math.inf)) for each in met)
    if all(each.stands.all() for each in met):
        raise NothingMetError('The robot stands while anything moves.')
    for each, clearance in chain.from_iterable(map(driven_into, legs)):
        value, at = float(clearance.min()), int(each.stamps[clearance.argmin()])
        words = {'nearest': each.name, 'where': where, 'stood': stood}
        yield Sample(value, 0.0, at, -value - _ROUNDING, words=words)


_APART: Final = {'unit': 'm', 'good': _apart_in_words, 'bad': _apart_in_words}


def track_gap(record: AuditRecord, _worst: object = None) -> str:
    """Obstacles that decisions used and the bag lacks, in a sentence; empty if there are none."""
    missing = sorted(
        key
        for leg in record.legs
        for key in leg.last_used.keys() - {each.key for each in leg.tracks}
        if isinstance(key[0], int)
    )
    if not missing:
        return ''
    number, stamp = missing[0]
    return (
        f'{len(missing)} obstacles that decisions used are not in the bag, such as {number} at'
        f' {record.seconds(stamp):.2f} s.'
    )


@check(
    'moving', 'Path: moving obstacles clear', **_APART,
    gaps=(lambda record, _: record.unusable['moving'], track_gap, path_gap),
)  # fmt: skip
def moving(record: AuditRecord) -> Iterator[Sample]:
    """Clearance from moving obstacles at their predicted positions, while the robot moved."""
    if not any(record.encounters):
        if record.unusable['moving']:
            raise NotJudgedError(record.unusable['moving'])
        known = (key for each in record.decisions for key, _ in each.tracks)
        if any(isinstance(key, int) for key in known) or record.history.has_traffic:
            topics = f'{record.places.moving} or {record.places.tracks}'
            raise NotJudgedError(f'The bag lacks the moving obstacles in {topics}.')
        raise SkippedError(f'No moving obstacle is in {record.places.moving}.')
    yield from _apart(record.encounters, ', at its predicted position')


@check(
    'people', 'Path: people untouched', **_APART,
    gaps=(lambda record, _: record.people_sentence, path_gap),
)  # fmt: skip
def people(record: AuditRecord) -> Iterator[Sample]:
    """Clearance from people in the simulator at their true positions, while the robot moved."""
    if not record.people:
        if record.unusable['people']:
            raise NotJudgedError(record.unusable['people'])
        if record.history.has_people:
            raise NotJudgedError(f'The bag lacks the people in {record.places.people}.')
        raise SkippedError('No people are known to walk about.')
    if not any(record.people_met):
        raise NothingMetError('Nobody comes near the robot.')
    yield from _apart(record.people_met, ', at its true position')


@check(
    'others', 'Path: clear of other robots', **_APART,
    gaps=(lambda record, _: record.others_sentence, path_gap),
)  # fmt: skip
def others(record: AuditRecord) -> Iterator[Sample]:
    """Clearance from the other robots at their positions, while the robot moved."""
    if not record.settings.moving_obstacles.others:
        raise SkippedError('No other robots are to be kept clear of (others.namespaces).')
    if not any(record.robot_encounters):
        reason = 'The bag has no path of others at the time of this one.'
        raise NotJudgedError(record.others_sentence or reason)
    yield from _apart(record.robot_encounters, '')


@check(
    'margin', 'Path: margin kept', needs=(*_ROAD, 'safety.margin'), gaps=(sensor_gap, path_gap),
    **_CLEAR,
)  # fmt: skip
def margin(record: AuditRecord) -> Iterator[Sample]:
    """Clearance above the margin asked for."""
    if not any(each.settings.safety.margin for each in record.sweeps):
        raise SkippedError('No margin was asked for (safety.margin is 0).')
    yield from _clear(record, slice(None), margin=True)


@check(
    'nominal', 'Fallback: nominal is clear', needs=_ROAD, of_decisions=True, unit='m',
    of_reach=True, good='Wherever the level is nominal, the path driven is clear.',
    bad='While the level is nominal, the path driven is {depth:.3g} m too close.',
    gaps=(lambda record, worst: sensor_gap(record) or path_gap(record, worst),),
)  # fmt: skip
def nominal(record: AuditRecord) -> Iterator[Sample]:
    """Clearance of the path driven wherever the level is nominal."""
    is_any = False
    for leg, sweeps in zip(record.legs, record.evidence_of_legs, strict=True):
        answers = sorted((each for each in leg.decisions if not each.halted), key=_stamp)
        stamps = np.array([each.stamp for each in answers], dtype=np.int64)
        good = np.array([each.level == 'nominal' for each in answers])
        for sweep in sweeps if answers else ():
            level = np.searchsorted(stamps, sweep.stamps, side='right') - 1
            period = sweep.settings.control_period * NANOSECONDS
            under: BoolArray = (level >= 0) & good[np.maximum(level, 0)]
            under &= sweep.stamps - stamps[np.maximum(level, 0)] < period
            least = sweep.clearance.min(axis=1)[under] + sweep.tolerance
            if len(least) and least.min() < np.inf:
                is_any, at = True, int(sweep.stamps[under][least.argmin()])
                depth = -float(least.min())
                yield Sample(-depth, 0.0, at, depth - _ROUNDING, words={'depth': depth})
    if not is_any:
        raise SkippedError('No control step has level nominal.')


def _no_pose(record: AuditRecord, _worst: Sample) -> str:
    unknown = sum(
        is_within(stamp, leg.by_odometry.holes) and bool(twist.any())
        for leg in record.legs
        for stamp, twist in zip(leg.commands.stamps.tolist(), leg.commands.twists, strict=True)
        if np.isfinite(twist).all()
    )
    return f'{unknown} commands have no pose in the bag.' if unknown else ''


def _leads_in_words(worst: Sample) -> str:
    nearest = worst.words['nearest']
    if worst.passes:
        return f'No command leads off the road or into an obstacle; nearest is {nearest}.'
    return f'A command leads {-worst.value:.3g} m too close to {nearest} before the next is due.'


@check(
    'commanded', 'Commands: safe to drive', needs=(*_ROAD, 'control_period'), unit='m',
    of_reach=True, good=_leads_in_words, bad=_leads_in_words, nothing='No command is finite.',
    gaps=(_no_pose, sensor_gap),
)  # fmt: skip
def commanded(record: AuditRecord) -> Iterator[Sample]:
    """Clearance of each command's arc, held for a period from the pose where it takes effect.

    That is the pose of its odometry, or with `command_delay`, or with a delay or lag that was
    estimated, the one measured that much later. A robot that is too close already may only be
    commanded not to get closer.
    """
    for leg, seeing in zip(record.legs, record.knowledge(), strict=True):
        commands, _, poses = in_effect(leg)
        stamps, near = commands.stamps.tolist(), math.nan
        for index, (pose, twist) in enumerate(zip(poses, commands.twists, strict=True)):
            stamp = stamps[index]
            if is_within(stamp, leg.by_odometry.holes):
                continue
            epoch = leg.history.epoch_at(stamp)
            settings = seeing(epoch.course, stamp)
            period = settings.control_period
            if index + 1 < len(stamps):
                held = (stamps[index + 1] - stamp) / NANOSECONDS
                period = min(max(held, 0.0), period)
            near = project_on_path(settings.road, pose, near)
            spare = _spare(settings, pose, twist, period, near)
            spare[EDGES:][epoch.of_hidden] += leg.by_odometry.off
            least, column = float(spare.min()), int(spare.argmin())
            names = (*settings.road.edge_names, *(f'obstacle {o.name}' for o in settings.obstacles))
            words = {'nearest': names[column]}
            yield Sample(least, 0.0, stamp, -least - ROUGHNESS - _ROUNDING, words=words)


def in_effect(leg: Leg) -> tuple[Commands, Array, Array]:
    """Finite commands of a leg, delays of their effects ``(M,)`` [s], and poses then ``(M, 3)``."""
    decisions = {each.stamp: each for each in leg.decisions}
    commands = leg.commands.chosen(np.all(np.isfinite(leg.commands.twists), axis=1))
    delays = [
        _effect_delay(leg.history.at(each), decisions.get(each))
        for each in commands.stamps.tolist()
    ]
    return commands, np.array(delays), _measured(leg, commands.stamps, np.array(delays))


def _effect_delay(settings: GuidanceSettings, decision: DecisionRecord | None) -> float:
    """Delay from a command to its effect, as it was estimated when the command was decided [s]."""
    if decision is not None and decision.response_delay is not None:
        return float(decision.response_delay[0])
    lag = None if decision is None else decision.wheel_lag
    return settings.command_delay + (0.0 if lag is None else float(lag[0]))


def _measured(leg: Leg, stamps: IntArray, delays: Array) -> Array:
    """Latest poses when commands take effect, `delays` [s] after their stamps, ``(M, 3)``."""
    effects = stamps + np.round(np.multiply(delays, NANOSECONDS)).astype(np.int64)
    index = np.searchsorted(leg.odometry.stamps, effects, side='right') - 1
    poses = leg.odometry.poses[np.maximum(index, 0)]
    # Between two messages the robot has moved on, and nothing was decided there.
    late = effects > stamps
    poses[late] = interpolated(leg.odometry, effects[late])
    return poses


def _spare(
    settings: GuidanceSettings, pose: Array, twist: Array, period: float, near: float
) -> Array:
    """Clearance of an arc above the clearance required, ``(2 + M,)`` [m]."""
    space = settings.world.free_space(settings)
    start, held = pose[None], np.array([period])
    floor = np.minimum(space.at(start, near)[0], 0.0)
    if settings.safety.between_samples:
        spare: Array = space.along(start, twist[None], held, near)[0] - floor
    else:
        end = arc_ends(start, twist[None], held)
        spare = space.at(end, near)[0] - (floor - _SAMPLE_TOLERANCE)
    return spare
