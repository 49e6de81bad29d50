"""The promise, judged from the bag: each command leaves a stop that nothing that moves can reach.

Nothing of the guidance is used for it: paths are sampled, and the places that an obstacle may reach
are computed here once more, from the tracks and the parameters.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.bags.audit.finding import NotJudgedError, Sample, SkippedError, check
from cmpsp_ros.bags.audit.legs import Commands
from cmpsp_ros.bags.audit.path_checks import in_effect, track_gap
from cmpsp_ros.bags.audit.record import AuditRecord, path_gap
from cmpsp_ros.bags.runs.odometry import arc_steps, is_within
from cmpsp_ros.bags.runs.run import Planned
from cmpsp_ros.guidance import NANOSECONDS, SEEN, GuidanceSettings
from cmpsp_ros.guidance.messages import Track
from cmpsp_ros.robots import placed
from cmpsp_ros.robots.motion import arc_ends, least_scale, with_side
from cmpsp_ros.world.grids import Cell, GridObstacle, OccupancyGrid

_STEP: Final = 0.01  # time between two samples of a path [s]
_TOLERANCE: Final = 5e-3  # error of a clearance by rounding and by sampling of the start [m]
_ASSUMED: Final = {'people.max_acceleration', 'safety.max_obstacle_speed'}
_AT_REST: Final = 1e-6  # fraction of a command that is rounding, and no motion
# Doubt about a position beyond which an obstacle is out of sight, and distance then [m].
_LOST, _APART = 0.5, 0.95
_CREEP: Final = 0.051  # speed up to which a robot counts as standing [m/s]


def _kept_in_words(worst: Sample) -> str:
    name, kept = worst.words['name'], worst.value
    if worst.passes:
        return f'Nothing could reach the robot before a stop; {name} comes to {kept:.3g} m.'
    return f'{name} could be {-kept:.3g} m into the robot before a stop takes effect.'


@check(
    'promise', 'Commands: stop in time', unit='m', of_reach=True,
    needs=('control_period',),
    good=_kept_in_words, bad=_kept_in_words, nothing='The robot is not commanded to move.',
    gaps=(lambda record, _: record.unusable['moving'], path_gap),
)  # fmt: skip
def promise(record: AuditRecord) -> Iterator[Sample]:
    """Clearance of each command and a stop after it from all that an obstacle may reach.

    A command that brakes as hard as the wheels can is not judged.
    """
    if missing := track_gap(record):
        raise NotJudgedError(missing)
    if not record.tracks and record.unusable['moving']:
        raise NotJudgedError(record.unusable['moving'])
    if not record.tracks:
        raise SkippedError('Nothing that moves is in the bag.')
    if unknown := sorted(_ASSUMED - set(record.history.given)):
        raise NotJudgedError(f'The parameters do not say {", ".join(unknown)}.')
    for leg, plans in zip(record.legs, record.plans, strict=True):
        known = {each.key: each for each in leg.tracks}
        used = {
            each.stamp: [known[key] for key in each.tracks if key in known and known[key].is_seen]
            for each in leg.decisions
        }
        tracks = sorted(leg.tracks, key=lambda each: (each.stamp, each.id))
        commands, delays, poses = in_effect(leg)
        stamps = commands.stamps.tolist()
        latest, following = {}, iter([*tracks, None])
        upcoming = next(following)
        for k, stamp in enumerate(stamps):
            while upcoming is not None and upcoming.stamp <= stamp:
                latest[upcoming.id] = upcoming
                upcoming = next(following)
            settings = leg.history.at(stamp)
            seen = _tracks_at(stamp, latest.values(), used.get(stamp), settings)
            is_lost = is_within(stamp, leg.by_odometry.holes)
            if not seen or is_lost or not commands.moving[k] or _brakes(settings, commands, k):
                continue
            begin = stamp + delays[k] * NANOSECONDS
            stops = _stops(settings, poses[k], commands, k, plans.get(stamp))
            found = [_worst(settings, stop, seen, begin) for stop in stops]
            spare, name = max(found, key=lambda each: each[0])
            yield Sample(spare, 0.0, stamp, -spare - _TOLERANCE, words={'name': name})


def _tracks_at(
    stamp: int, latest: Iterable[Track], used: Iterable[Track] | None, settings: GuidanceSettings
) -> list[Track]:
    """Tracks at a decision [ns]: of own sensors those that it used, or without it the newest."""
    told = [each for each in latest if not each.is_seen]
    if used is None:
        # A newer sighting without it says that it is gone.
        newest = max((each.stamp for each in latest if each.is_seen), default=0)
        recent = stamp - newest <= settings.sight.timeout * NANOSECONDS
        used = [each for each in latest if each.is_seen and each.stamp == newest and recent]
    timeout = settings.moving_obstacles.timeout * NANOSECONDS
    return [*used, *(each for each in told if stamp - each.stamp <= timeout)]


@check(
    'unseen', 'Commands: slow out of sight', unit='m/s',
    needs=('control_period',),
    good='Once anything had moved, no command leads out of sight faster than {creep:.3g} m/s.',
    bad='Something had moved, and a command leads out of sight at {worst:.3g} m/s.',
    nothing='The robot is not commanded to move after anything had.', gaps=(path_gap,),
)  # fmt: skip
def unseen(record: AuditRecord) -> Iterator[Sample]:
    """Speed of commands that lead, with a stop after them, into cells that are remembered only."""
    if not record.settings.sight.sensors:
        raise SkippedError('No sensor tracks moving obstacles.')
    if 'safety.stop_within_sight' not in record.history.given:
        raise NotJudgedError('The parameters do not say safety.stop_within_sight.')
    unknown, failed = 0, False
    known = zip(record.legs, record.plans, record.knowledge(), strict=True)
    for leg, plans, seeing in known:
        ids = ((each.stamp, key) for each in leg.decisions for key, _ in each.tracks)
        moved = min((at for at, key in ids if isinstance(key, int)), default=math.inf)
        commands, _, poses = in_effect(leg)
        for k, stamp in enumerate(commands.stamps.tolist()):
            settings = leg.history.at(stamp)
            obstacles = seeing(settings, stamp).obstacles
            grids = (each for each in obstacles if isinstance(each, GridObstacle))
            seen = next((each.grid for each in grids if each.name == SEEN), None)
            is_lost = is_within(stamp, leg.by_odometry.holes)
            if settings.safety.stop_within_sight == 'off' or is_lost:
                continue
            if stamp < moved or not commands.moving[k]:
                continue
            if seen is None:
                unknown += 1
                continue
            speed = float(np.hypot(*with_side(commands.twists[k : k + 1])[0, :2]))
            stops = _stops(settings, poses[k], commands, k, plans.get(stamp))
            is_slow = speed <= _CREEP or _brakes(settings, commands, k)
            if is_slow or not all(_is_out_of_sight(settings, seen, each) for each in stops):
                speed = 0.0
            found = Sample(speed, 0.05, stamp, speed - _CREEP, words={'creep': 0.05})
            failed |= not found.passes
            yield found
    if unknown and not failed:
        topic = record.places.sighting
        raise NotJudgedError(f'The bag has nothing in {topic} before {unknown} commands to move.')


def _is_out_of_sight(
    settings: GuidanceSettings, grid: OccupancyGrid, stop: tuple[Array, Array]
) -> bool:
    """True if the front of the robot comes to where no cell within one of it is in sight."""
    places = stop[1][:, :2]
    way = np.diff(places, axis=0)
    lengths = np.hypot(*way.T)
    drives = lengths > 0.0
    ahead = settings.circumscribed_radius * way[drives] / lengths[drives, None]
    around = grid.resolution * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
    cells = grid.at((places[1:][drives] + ahead)[:, None] + around)
    return bool((cells == Cell.REMEMBERED).all(axis=1).any())


def _brakes(settings: GuidanceSettings, commands: Commands, k: int) -> bool:
    """True if a wheel could not brake harder: no stop could come to rest earlier."""
    robot, change = settings.robot, settings.max_wheel_change
    if k == 0 or change == math.inf:
        return False
    wheels = robot.wheel_speeds(commands.twists[k - 1 : k + 1])
    before, now = np.abs(wheels).max(axis=1)
    if now <= max(before - change, 0.0) + _TOLERANCE:
        return True
    # Another wheel may have to brake harder than the fastest one.
    hardest = np.abs(np.diff(wheels, axis=0)).max()
    return bool(now < before and abs(hardest - change) <= _TOLERANCE)


def _stops(
    settings: GuidanceSettings, pose: Array, commands: Commands, k: int, plan: Planned | None
) -> Iterator[tuple[Array, Array]]:
    """Times ``(K,)`` and poses ``(K, 3)`` of a command and a stop: curved alike, or as the plan."""
    period, twist = settings.control_period, commands.twists[k]
    if k + 1 < len(commands.stamps):
        held = float(commands.stamps[k + 1] - commands.stamps[k]) / NANOSECONDS
        period = min(max(held, 0.0), period) or period
    yield _stop(settings, pose, twist[None], period)
    durations = np.empty(0) if plan is None else np.diff(plan.stamps[1:]) / NANOSECONDS
    if plan is not None and len(durations) and durations.min() > 0.0:
        planned = arc_steps(plan.poses[1:-1], plan.poses[2:]) / durations[:, None]
        planned = planned if len(twist) == 3 else planned[:, ::2]
        yield _stop(settings, pose, np.vstack([twist, planned]), period)


def _stop(
    settings: GuidanceSettings, pose: Array, twists: Array, period: float
) -> tuple[Array, Array]:
    """Times and poses of the first twist for a period [s], and of a stop curved as the others."""
    robot, limit = settings.robot, settings.max_wheel_change
    wheels = np.abs(robot.wheel_speeds(twists)).max(axis=1)
    top, driven = wheels[0], [(twists[0], period)]
    while top > limit + _AT_REST * wheels[0]:
        k = min(len(driven), len(twists) - 1)
        before, planned = robot.controls(driven[-1][0]), robot.controls(twists[k])
        # As all wheels can brake; one that turns round, as the fastest one.
        least = least_scale(planned, before, limit, robot.time_scaling)
        scale = min(max(least, (top - limit) / max(wheels[k], 1e-12)), 1.0)
        top = scale * wheels[k]
        driven.append((scale * twists[k], settings.control_period))
    poses, durations = [pose], [0.0]
    for twist, duration in driven:
        count = math.ceil(duration / _STEP)
        for _ in range(count):
            poses.append(arc_ends(poses[-1][None], twist[None], np.array([duration / count]))[0])
        durations += [duration / count] * count
    return np.cumsum(durations), np.array(poses)


def _worst(
    settings: GuidanceSettings, stop: tuple[Array, Array], seen: Sequence[Track], begin: float
) -> tuple[float, str]:
    """Least clearance on a path, beyond what is allowed [m], and from what.

    A robot that creeps may leave what is there, and pass what stands; one that is no nearer than at
    rest may leave what is out of sight. `begin` is the time of the beginning [ns].
    """
    times, poses = stop
    discs, radius = settings.footprint.discs, settings.robot_radius
    points = np.array([placed(discs, each) for each in poses])
    moved = np.linalg.norm(np.diff(points, axis=0), axis=-1).max(axis=1)
    creeps = (moved / np.maximum(np.diff(times), 1e-9)).max(initial=0.0) <= _CREEP
    worst, name, moving = math.inf, '', settings.moving_obstacles

    def away(places: Array, centers: Array) -> Array:
        apart = np.linalg.norm(places - centers[..., None, :], axis=-1)
        return np.asarray(apart.min(axis=-1) - radius)

    for each in seen:
        place, since = np.array([each.x, each.y]), (begin - each.stamp) / NANOSECONDS + times
        velocity, growth = _velocities(each, moving.max_speed)
        certain = each.radius + 3.0 * each.position_stddev
        reach = certain + growth * since + 0.5 * moving.max_acceleration * since**2
        centers = place + since[:, None] * velocity
        apart = away(points, centers)
        clear = apart - reach
        # No faster than anything is, it is not out of this disc either.
        if math.hypot(*velocity) - growth <= moving.max_speed:
            still = away(points, place)
            clear = np.maximum(clear, still - certain - moving.max_speed * since)
        seen_velocity = np.array([each.vx, each.vy])
        now = place + since[0] * seen_velocity
        there = away(points, now) - each.radius
        touched = there[0] < 0.0
        spare = float(clear.min()) - (0.0 if touched else min(float(clear[0]), 0.0))
        comes = float((poses[0, :2] - now) @ seen_velocity) > 0.0
        if reach[0] - each.radius > _LOST and there[0] > _APART and not comes:
            spare = max(spare, float((apart - away(points[0], centers)).min()))
        if creeps:
            stands = math.hypot(each.vx, each.vy) <= _CREEP
            kept = min(float(there[0]), 0.0) if stands else float(there[0])
            spare = max(spare, float(there.min()) - kept)
        if spare < worst:
            worst, name = spare, each.name
    return worst, name


def _velocities(seen: Track, top: float) -> tuple[Array, float]:
    """Centre ``(2,)`` and radius of a disc of the velocities that the promise allows [m/s].

    They are those within three standard deviations and up to `top`; one that was seen to be faster
    keeps its speed.
    """
    velocity, spread = np.array([seen.vx, seen.vy]), 3.0 * seen.velocity_stddev
    speed = math.hypot(seen.vx, seen.vy)
    # The chord on which the circles of both limits cross.
    along = (speed**2 + top**2 - spread**2) / max(2.0 * speed, 1e-12)
    if speed - spread > top or along >= speed:
        return velocity, spread
    along = max(along, 0.0)
    return along * velocity / max(speed, 1e-12), math.sqrt(max(top**2 - along**2, 0.0))
