"""One run: the guidance law and the plant until the final time, judged by the true path."""

import math
from collections import Counter
from dataclasses import asdict, dataclass, field

import numpy as np

from cmpsp_ros.arrays import Array, IntArray
from cmpsp_ros.guidance import (
    NANOSECONDS,
    Decision,
    FallbackLevel,
    GuidanceLaw,
    Observation,
    to_nanoseconds,
)
from cmpsp_ros.guidance.safety import CHANGE_ROUNDING
from cmpsp_ros.robots import placed
from cmpsp_ros.sensing import Track
from cmpsp_ros.simulator import Motion, OdometrySchedule, People, Plant
from cmpsp_ros.studies.monte_carlo.contacts import CrowdOutcome, contacts
from cmpsp_ros.studies.monte_carlo.foreign_robot import ForeignDrive, ForeignRobot
from cmpsp_ros.studies.monte_carlo.guesses import shortest_length
from cmpsp_ros.studies.monte_carlo.outcome import StudyOutcome
from cmpsp_ros.studies.monte_carlo.study import RunTask

_LAGS_TO_REST = 20.0
_ROUNDING = 1e-9
_EDGES = 2


@dataclass
class DrivenRun:
    """A completed run: motions, the last at rest, and decisions up to the final time [ns]."""

    task: RunTask
    motions: list[Motion] = field(default_factory=list)
    decisions: list[Decision] = field(default_factory=list)
    exception: str = ''  # type and text of an exception of the law; empty if there was none
    end: int = 0
    walking: People | None = None  # those who walk about, if any
    # Instants [ns], and the states of all people from then on, as of `People.at`.
    people: list[tuple[int, Array]] = field(default_factory=list)

    @property
    def stamps(self) -> IntArray:
        """Instants of all motions, ``(K + 1,)`` [ns]."""
        return np.array([each.stamp_ns for each in self.motions], dtype=np.int64)

    @property
    def poses(self) -> Array:
        """Poses then, ``(K + 1, 3)`` [m, m, rad]."""
        return np.array([each.pose for each in self.motions])

    @property
    def arcs(self) -> tuple[Array, Array, Array]:
        """Initial poses ``(K, 3)``, twists and durations ``(K,)`` [s] of the arcs between them."""
        twists = np.array([each.twist for each in self.motions[:-1]])
        return self.poses[:-1], twists, np.diff(self.stamps) / NANOSECONDS

    @property
    def controls(self) -> Array:
        """Controls commanded until the final time, shape ``(K, r)``."""
        robot = self.task.settings.robot
        sent = [each for each in self.decisions if not each.late]
        controls = np.array([robot.controls(each.twist) for each in sent])
        for index, each in enumerate(sent):
            if each.steering_angle is not None:
                # At rest a twist says nothing of it.
                controls[index, -1] = each.steering_angle
        return controls.reshape(-1, robot.n_controls)

    def at(self, stamp: int) -> Array:
        """Pose at an instant that is among the motions, shape ``(3,)`` [m, m, rad]."""
        return next(each.pose for each in reversed(self.motions) if each.stamp_ns == stamp)

    def clearance(self) -> Array:
        """Clearance of arcs from outer edge, inner edge, obstacles, shape ``(K, 2 + M)`` [m]."""
        return self.task.truth.world.clearance(self.task.truth, *self.arcs)


class Computer:
    """A computer that needs random time for each step, and keeps the decision until it is sent."""

    def __init__(self, task: RunTask) -> None:
        self._period, self._lateness = task.settings.control_period, task.kind.lateness
        self._random = np.random.default_rng([task.scenario.seed, task.scenario.number])
        self.busy_until = 0
        self.decision: Decision | None = None

    def take(self, law: GuidanceLaw, decision: Decision | None) -> None:
        """Spend the time of a decision, and withdraw it as the node does where that is too long."""
        if decision is None:
            return
        took = 0.0
        if self._lateness and decision.iterations:
            took = self._period * self._random.uniform(0.0, self._lateness)
        self.busy_until = decision.stamp + to_nanoseconds(took)
        is_late = took > self._period and decision.plan is not None
        recorded = law.after_step(took if is_late else 0.0)
        self.decision = recorded if is_late else decision


def drive(task: RunTask) -> DrivenRun:
    """Make a run until the robot is at rest; an exception in the law stops it, as in the node."""
    if task.foreign is not None:
        return _drive_foreign(task, task.foreign)
    driven, plant = DrivenRun(task, walking=task.people()), Plant(task.plant)
    driven.motions.append(plant.motion)
    _walk(driven, plant)
    driven.end = to_nanoseconds(task.settings.final_time)
    instants, noted = OdometrySchedule(task.plant, 0), 0
    try:
        law = GuidanceLaw(task.settings, task.settings.world)
        computer, eyes = Computer(task), task.eyes(driven.walking)
        # At the very end the law may still put it off.
        while (stamp := instants.next_ns) < driven.end + int(task.settings.moves_final_time):
            _hand_over(plant, driven, computer, stamp)
            _advance(plant, driven, stamp)
            pose = plant.measure()
            if pose is not None and stamp >= computer.busy_until:
                sighting = None
                if eyes is not None:
                    eyes.note(*driven.motions[noted:])
                    eyes.look(stamp)
                    noted, sighting = len(driven.motions), eyes.see(stamp, pose)
                seen = () if sighting is None else sighting.tracks
                tracks = _told(driven, stamp) or seen
                decision = law.step(Observation(stamp, pose, tracks, sighting))
                computer.take(law, decision)
                if task.settings.moves_final_time and law.ends_at is not None:
                    driven.end = min(law.ends_at, to_nanoseconds(task.patience))
                _hand_over(plant, driven, computer, stamp)
            instants.advance()
        _hand_over(plant, driven, computer, driven.end)
        _advance(plant, driven, driven.end)
        if task.settings.max_wheel_change < math.inf:
            _brake(plant, driven, law, instants.period_ns)
    except Exception as error:
        # The study goes on and reports it.
        driven.exception = f'{type(error).__name__}: {" ".join(str(error).split())}'
        plant.command(plant.stamp_ns, 0.0, 0.0)
    end = max(driven.end, plant.stamp_ns)
    _advance(plant, driven, end)
    plant.command(end, 0.0, 0.0)
    # The wheels' lag never quite ends.
    lag = _LAGS_TO_REST * task.plant.wheel_lag
    delay = task.plant.actuation_delay + task.plant.actuation_jitter + task.plant.actuation_period
    _advance(plant, driven, end + to_nanoseconds(delay + lag + 1.0 / task.plant.odom_rate))
    return driven


def _drive_foreign(task: RunTask, foreign: ForeignRobot) -> DrivenRun:
    drive = ForeignDrive(foreign, task.settings.robot, task.scenario.pose)
    driven = DrivenRun(task, drive.motions, drive.decisions)
    try:
        drive.run(GuidanceLaw(task.settings, task.settings.world), task.settings.control_period)
    except Exception as error:
        driven.exception = f'{type(error).__name__}: {" ".join(str(error).split())}'
    driven.end = min(drive.end, drive.motions[-1].stamp_ns)
    return driven


def _brake(plant: Plant, driven: DrivenRun, law: GuidanceLaw, period: int) -> None:
    """Let the law bring the robot to rest after the final time, or where patience is at an end."""
    moves, gave_up = True, law.ends_at is not None and law.ends_at > driven.end
    while moves:
        pose, decision = plant.measure(), None
        if gave_up:
            decision = law.halt(plant.stamp_ns, 'The run takes too long.', braking=True)
            period = to_nanoseconds(driven.task.settings.control_period)
        elif pose is not None:
            decision = law.step(Observation(plant.stamp_ns, pose))
        if decision is not None:
            plant.command(plant.stamp_ns, *decision.twist.tolist())
            moves = bool(np.any(decision.twist))
        _advance(plant, driven, plant.stamp_ns + period)


def outcome(driven: DrivenRun) -> StudyOutcome:
    """The figures of a run."""
    task, settings = driven.task, driven.task.settings
    space = task.truth.world.free_space(task.truth)
    final = driven.end
    clearance = driven.clearance()
    speeds = [each.wheel_speeds for each in driven.decisions]
    largest = [float(np.abs(each).max()) for each in speeds if np.isfinite(each).all()]
    limit = settings.robot.max_wheel_speed * (1.0 + _ROUNDING)
    # At the first step it may stand to make a plan.
    decided = [each for each in driven.decisions if each.step or each.plan is not None]
    levels = Counter(each.level for each in decided)
    worst = max(decided, key=lambda each: each.level, default=None)
    x, y = _instants(driven, final)
    return StudyOutcome(
        number=task.scenario.number,
        miss=math.dist(driven.at(final)[:2], settings.goal),
        road_clearance=float(clearance[:, :_EDGES].min()),
        obstacle_clearance=float(clearance[:, _EDGES:].min()) if task.truth.obstacles else None,
        began_outside=bool(space.at(driven.motions[0].pose[None]).min() < 0.0),
        max_wheel_speed=max(largest, default=0.0),
        too_fast=sum(each > limit for each in largest),
        over_limit=_over_limit(driven),
        not_finite=len(speeds) - len(largest),
        nominal=levels[FallbackLevel.NOMINAL],
        elastic=levels[FallbackLevel.ELASTIC],
        previous_plan=levels[FallbackLevel.PREVIOUS_PLAN],
        stop=levels[FallbackLevel.STOP],
        trouble=worst.reason if worst is not None and worst.level else '',
        trouble_time=worst.stamp / NANOSECONDS if worst is not None and worst.level else None,
        exception=driven.exception,
        shortest_way=settings.road.shortest_length(task.scenario.pose[:2], settings.goal),
        farthest=farthest(task),
        obstacles=len(task.truth.obstacles),
        x=x,
        y=y,
        time=task.settings.final_time if task.foreign else driven.end / NANOSECONDS,
        told_error=None if task.foreign is None else task.foreign.told_error,
        pace=_shortest(task) / (final / NANOSECONDS) / settings.pace if task.kind.has_map else None,
        slowness=_slowness(driven),
        crowd=_crowd(driven),
    )


def _crowd(driven: DrivenRun) -> CrowdOutcome | None:
    crowd, people = driven.task.crowd, driven.walking
    if crowd is None:
        return None
    found = () if people is None else contacts(driven, people.names)
    return CrowdOutcome(**asdict(crowd), people=len(people or ()), contacts=found)


def _over_limit(driven: DrivenRun) -> int:
    settings, controls = driven.task.settings, driven.controls
    if not np.isfinite(controls).all():
        return 0
    robot = settings.robot
    before = np.vstack([robot.at_rest, controls])
    changes = np.abs(np.diff(before, axis=0) @ robot.rate_limits.T).max(axis=1)
    sudden = changes > settings.max_wheel_change + CHANGE_ROUNDING
    return int(sum(sudden | [bool(robot.over_limit(each[None])) for each in controls]))


def _slowness(driven: DrivenRun) -> float | None:
    """Time until the robot has arrived, by that of the shortest path at the speed of the score."""
    goal, kind = driven.task.settings.goal, driven.task.kind
    if kind.score_speed is None:
        return None
    near = (each for each in driven.motions if math.dist(each.pose[:2], goal) <= kind.tolerance)
    arrived = next(near, driven.motions[-1]).stamp_ns / NANOSECONDS
    return arrived * kind.score_speed / _shortest(driven.task)


def _shortest(task: RunTask) -> float:
    return shortest_length(task.truth, np.array(task.scenario.pose))


def farthest(task: RunTask) -> float:
    """Distance from rest until the final time at the robot's limit [m]; random slip is ignored."""
    plant, time = task.plant, task.settings.final_time
    if plant.wheel_slip_stddev > 0.0:
        return math.inf
    grip = 1.0 - sum(plant.wheel_slip) / len(plant.wheel_slip)
    obeyed = max(time - plant.actuation_delay, 0.0)
    lag = plant.wheel_lag
    behind = lag * -math.expm1(-obeyed / lag) if lag > 0.0 else 0.0
    # The first commands are slower, as far as the acceleration is limited.
    steps = plant.robot.max_wheel_speed / task.settings.max_wheel_change
    slower = sum(1.0 - k / steps for k in range(1, math.ceil(steps)))
    behind += task.settings.control_period * slower
    return plant.robot.max_speed * grip * (obeyed - behind)


def _advance(plant: Plant, driven: DrivenRun, stamp: int) -> None:
    driven.motions += plant.advance(stamp)
    driven.motions.append(plant.motion)
    _walk(driven, plant)


def _walk(driven: DrivenRun, plant: Plant) -> None:
    if driven.walking is None:
        return
    if driven.decisions:
        driven.walking.begin(plant.stamp_ns)
    settings = driven.task.settings
    robot = placed(settings.footprint.discs, plant.pose)
    driven.walking.advance(plant.stamp_ns, robot, settings.robot_radius)
    if not driven.people or driven.people[-1][0] < plant.stamp_ns:
        driven.people.append((plant.stamp_ns, driven.walking.at(plant.stamp_ns)))


def _told(driven: DrivenRun, stamp: int) -> tuple[Track, ...]:
    crowd = driven.task.crowd
    if driven.walking is None or crowd is None or not crowd.told:
        return ()
    return tuple(
        Track(number, stamp, radius, x, y, u, v)
        for number, (x, y, u, v, radius) in enumerate(driven.walking.at(stamp).tolist())
    )


def _hand_over(plant: Plant, driven: DrivenRun, computer: Computer, stamp: int) -> None:
    """Let the plant have the decision that the computer has made until an instant [ns]."""
    decision = computer.decision
    if decision is None or computer.busy_until > stamp:
        return
    if computer.busy_until > plant.stamp_ns:
        _advance(plant, driven, computer.busy_until)
    computer.decision = None
    if not decision.finished:
        driven.decisions.append(decision)
    if not decision.late and np.isfinite([*decision.twist, *decision.wheel_speeds]).all():
        plant.command(plant.stamp_ns, *decision.twist.tolist())


def _instants(driven: DrivenRun, final: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Positions at the beginning of each control period, and at the final time [m]."""
    period = to_nanoseconds(driven.task.settings.control_period)
    chosen, due = [], driven.motions[0].stamp_ns
    for motion in driven.motions:
        if due <= motion.stamp_ns < final:
            chosen.append(motion.pose)
            due += period
    chosen.append(driven.at(final))
    x, y = (tuple(float(each[axis]) for each in chosen) for axis in (0, 1))
    return x, y
