"""Random drives of the real law on the real plant, and what may be wrong with their bags.

Whether a drive was clean is judged here by plain geometry along its exact path, 1 ms apart.
"""

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
from bag_messages import (
    GRID,
    ODOMETRY,
    SECOND,
    TWIST,
    grid,
    make,
    odometry,
    raw,
    time,
    twist,
    write_bag,
)

from cmpsp_ros.bags.decision_record import DECISION, decision_message
from cmpsp_ros.guidance import GuidanceLaw, Observation
from cmpsp_ros.parameters import (
    TABLE,
    ParameterError,
    guidance_settings,
    laser_settings,
    load_parameter_file,
    plant_settings,
)
from cmpsp_ros.robots.motion import arc_ends
from cmpsp_ros.sensing import REMEMBERED, Surroundings, sight_of
from cmpsp_ros.simulator import Laser, Plant, discs_of, edges_of
from cmpsp_ros.studies.monte_carlo.courses.ring_courses import scenario
from cmpsp_ros.world.grids import Cell
from cmpsp_ros.world.obstacles import Obstacle

START = 1_700_000_000 * SECOND
SCAN = 'sensor_msgs/msg/LaserScan'
SIGHTING, DECISIONS = '/guidance/sighting', '/guidance/decision'
TOPICS = {
    '/odom': ODOMETRY,
    '/sim/truth': ODOMETRY,
    '/cmd_vel': TWIST,
    DECISIONS: DECISION,
    '/scan': SCAN,
    SIGHTING: GRID,
}
PATH = ('/odom', '/sim/truth')
REST = 0.6


class Message(NamedTuple):
    topic: str
    received: int
    data: bytes


class Disc(NamedTuple):
    x: float
    y: float
    radius: float


@dataclass(frozen=True)
class Course:
    """A drive as a bag may have it, and how it really was.

    Attributes:
        guidance: Parameters of the guidance node.
        sim: Those of the simulator; None if the bag lacks them.
        messages: In order of reception.
        path: Exact poses, 1 ms apart, shape ``(K, 3)``.
        discs: What stands on the course.
        holes: Times at which nothing is known [s].
    """

    guidance: dict
    sim: dict | None
    messages: tuple[Message, ...]
    path: np.ndarray
    discs: tuple[Disc, ...]
    holes: tuple[tuple[float, float], ...] = ()

    def clearance(self):
        """Clearance of the robot at each pose of the path, without the holes [m]."""
        x, y, radius = *self.path[:, :2].T, self.guidance['robot.radius']
        away = [np.hypot(x - each.x, y - each.y) - each.radius for each in self.discs]
        away.append(self._from_edges())
        clearance = np.min(away, axis=0) - radius
        seconds = np.arange(len(clearance)) / 1e3
        for begin, end in self.holes:
            clearance[(seconds > begin) & (seconds < end)] = math.inf
        return clearance

    def _from_edges(self):
        if self.guidance['road.type'] == 'corridor':
            # All of them lie along the x axis.
            return self.guidance['road.half_width'][0] - np.abs(self.path[:, 1])
        center, inner, outer = (
            self.guidance[f'road.{key}'] for key in ('center', 'inner_radius', 'outer_radius')
        )
        away = np.hypot(*(self.path[:, :2] - center).T)
        return np.minimum(away - inner, outer - away)

    @property
    def arrived(self):
        end = self.path[round(1e3 * self.guidance['final_time']), :2]
        return math.dist(end, self.guidance['goal.position']) <= self.guidance['goal.tolerance']

    def without(self, wanted):
        """The same without the messages that a function of topic and time [s] is true of."""
        kept = (
            each
            for each in self.messages
            if not wanted(each.topic, (each.received - START) / SECOND)
        )
        return replace(self, messages=tuple(kept))

    def write(self, path):
        given = {'/guidance': self.guidance} | ({} if self.sim is None else {'/sim': self.sim})
        there = {each.topic for each in self.messages}
        kinds = {topic: kind for topic, kind in TOPICS.items() if topic in there}
        return write_bag(path, self.messages, given, kinds)


@dataclass
class _Recorder:
    messages: list[Message] = field(default_factory=list)

    def write(self, topic, stamp, offset_ms, message):
        data = message if isinstance(message, bytes) else raw(message)
        self.messages.append(Message(topic, START + stamp + round(offset_ms * 1e6), data))


def drive(given, *, sees=True, **lied):
    """Let the law drive the plant.

    Args:
        given: Parameters of all nodes.
        sees: Whether the law hears the scanner; else it drives as if nothing were there.
        lied: What the recorded scanner is like, beside what it really is.
    """
    values = TABLE.resolve(given)
    settings, recorder = guidance_settings(values), _Recorder()
    plant, law = Plant(plant_settings(values)), GuidanceLaw(settings, settings.world)
    hidden = values['sim.obstacles.names']
    discs = [_disc(values, f'obstacles.{each}') for each in values['obstacles.names']]
    unknown = [_disc(values, f'sim.obstacles.{each}') for each in hidden]
    shapes = [Obstacle('', each[:2], each.radius) for each in unknown]
    eyes = _Eyes(values, settings, shapes) if settings.sight.sensors else None
    end, step = round((settings.final_time + REST) * SECOND), SECOND // 50
    motions, noted = [plant.motion], 0
    for stamp in range(0, end + 1, step):
        motions += [*plant.advance(stamp), plant.motion]
        pose, sighting = plant.measure(), None
        if eyes is not None:
            eyes.laser.note(*motions[noted:])
            noted, sighting = len(motions), eyes.look(stamp, pose, recorder)
        spread = values['noise.position_stddev']
        recorder.write('/odom', stamp, 1.0, odometry(START + stamp, pose, spread=spread))
        decision = law.step(Observation(START + stamp, pose, (), sighting if sees else None))
        if decision is not None:
            if sighting is not None and sighting.stamp == START + stamp:
                eyes.publish(sighting, recorder)
            recorder.write('/cmd_vel', stamp, 4.0, twist(*decision.twist))
            recorder.write(DECISIONS, stamp, 4.1, decision_message(decision, 'decision'))
            law.after_step()
            plant.command(stamp, *decision.twist.tolist())
            motions += [*plant.advance(stamp), plant.motion]
    for each in motions:
        truth = odometry(START + each.stamp_ns, each.pose, each.twist)
        recorder.write('/sim/truth', each.stamp_ns, 1.1, truth)
    times = np.arange(0, end, 1_000_000)
    stamps = np.array([each.stamp_ns for each in motions])
    index = np.searchsorted(stamps, times, side='right') - 1
    poses, twists = (np.array([getattr(m, key) for m in motions]) for key in ('pose', 'twist'))
    path = arc_ends(poses[index], twists[index], (times - stamps[index]) / SECOND)
    messages = tuple(sorted(recorder.messages, key=lambda each: each.received))
    return Course(dict(values), dict(values), messages, path, (*discs, *unknown))


class _Eyes:
    def __init__(self, values, settings, shapes):
        (self.sensor,), scanner = settings.sight.sensors, laser_settings(values)
        self.laser, self.scanner = Laser(scanner, 0), scanner
        self.around = edges_of(shapes), discs_of(shapes)
        self.surroundings = Surroundings(settings.sight, settings.robot_radius)

    def look(self, stamp, pose, recorder):
        while self.laser.is_due(stamp):
            scan = self.laser.scan(*self.around)
            message = self._message(scan)
            recorder.write('/scan', stamp, 0.5, message)
            self.surroundings.add(sight_of(message, self.sensor))
        self.surroundings.update(START + stamp, pose)
        return self.surroundings.at(START + stamp, pose)

    def publish(self, sighting, recorder):
        values = np.zeros(len(Cell), np.int8)
        values[[Cell.OCCUPIED, Cell.UNKNOWN, Cell.REMEMBERED]] = 100, -1, REMEMBERED
        known = sighting.grid
        message = grid(sighting.stamp, values[known.cells], known.origin[:2], known.resolution)
        recorder.write(SIGHTING, sighting.stamp - START, 3.0, message)

    def _message(self, scan):
        head = make('std_msgs/msg/Header', time(START + scan.stamp_ns), self.sensor.frame_id)
        a, ranges = self.scanner, scan.ranges.astype(np.float32)
        angles = a.angle_min, a.angle_max, a.angle_increment
        rest = a.time_increment, 1.0 / a.rate, a.range_min, a.range_max
        return make(SCAN, head, *angles, *rest, ranges, np.zeros(0, np.float32))


def _disc(values, block):
    return Disc(*values[f'{block}.center'], values[f'{block}.radius'])


def random_course(number, **changes):
    """Parameters of a drive on a ring with random discs, which the law is told of."""
    given = {**load_parameter_file('case3'), 'robot.radius': 0.1, **changes}
    for key in [each for each in given if each.startswith('obstacles.')]:
        del given[key]
    values = TABLE.resolve({**given, 'obstacles.names': []})
    drawn = scenario(guidance_settings(values), 7, number, 3)
    return {**given, **_named('obstacles', drawn.obstacles), 'initial_pose': list(drawn.pose)}


def seen_course(number, count=2, **changes):
    """Parameters of a drive down a corridor with one or two random discs, which a scanner shows."""
    random = np.random.default_rng([11, number])
    given = load_parameter_file('unknown')
    for key in [each for each in given if each.startswith('sim.obstacles.')]:
        del given[key]
    radii, sides = random.uniform(0.15, 0.35, 2), random.choice([-1.0, 1.0], 2)
    places = zip((3.0, 5.5), sides * random.uniform(0.0, 0.4, 2), radii, strict=True)
    discs = [Obstacle(f'o{k}', (x, y), radius) for k, (x, y, radius) in enumerate(places)][:count]
    goal = {'goal.position': [3.0 + 2.5 * count, 0.0], 'final_time': 8.0 + 6.0 * count}
    given |= {'sim.scan.count': 241}
    return {**given, **goal, **_named('sim.obstacles', discs), **changes}


def _named(section, obstacles):
    """Parameters of discs."""
    given = {f'{section}.names': [each.name for each in obstacles]}
    for each in obstacles:
        given[f'{section}.{each.name}.center'] = list(each.center)
        given[f'{section}.{each.name}.radius'] = each.radius
    return given


def moved_into(course, random, *, to=None):
    """A course in which a disc stands in the driven path; no sensor has seen it."""
    length = round(1e3 * course.guidance['final_time'])
    at = int(random.uniform(0.15, 0.85) * length) if to is None else to
    radius, robot = random.uniform(0.05, 0.3), course.guidance['robot.radius']
    # A cut of 3 mm and more.
    away = random.uniform(0.0, max(radius + robot - 0.003, 0.0))
    x, y, heading = course.path[at]
    side = random.choice([-1.0, 1.0])
    x, y = x - side * away * math.sin(heading), y + side * away * math.cos(heading)
    section = 'sim.obstacles' if course.guidance['sensors.names'] else 'obstacles'
    more = {
        f'{section}.names': [*course.guidance[f'{section}.names'], 'moved'],
        f'{section}.moved.center': [x, y],
        f'{section}.moved.radius': radius,
    }
    return _changed(course, more, (*course.discs, Disc(x, y, radius)))


def narrowed(course, random):
    """A course whose road is narrower than what was driven, with the goal still on it."""
    for _ in range(100):
        changed = _narrower(course, random)
        try:
            guidance_settings(changed.guidance)
        except ParameterError:
            continue
        return changed
    return moved_into(course, random)


def _narrower(course, random):
    most = float(random.uniform(0.003, 0.2))
    if course.guidance['road.type'] == 'corridor':
        used = np.abs(course.path[:, 1]).max() + course.guidance['robot.radius']
        return _changed(course, {'road.half_width': [max(used - most, 0.25)]}, course.discs)
    away = np.hypot(*(course.path[:, :2] - course.guidance['road.center']).T)
    key, used = (
        ('road.outer_radius', away.max() + course.guidance['robot.radius'] - most)
        if random.random() < 0.5
        else ('road.inner_radius', away.min() - course.guidance['robot.radius'] + most)
    )
    return _changed(course, {key: float(used)}, course.discs)


def _changed(course, changes, discs):
    sim = None if course.sim is None else TABLE.resolve({**course.sim, **changes})
    guidance = TABLE.resolve({**course.guidance, **changes})
    return replace(course, guidance=dict(guidance), sim=sim and dict(sim), discs=discs)
