"""Speed limit before obstacles that a plan leads into: the robot stops before them.

Where no plan passes one the best leads through it, and only its first arc is checked.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.guidance.decision import Plan
from cmpsp_ros.guidance.prediction.estimator import PlanStart
from cmpsp_ros.guidance.prediction.response import Risk
from cmpsp_ros.guidance.safety.reach_check import CREEP
from cmpsp_ros.guidance.safety.road_braking import brakings_on_road
from cmpsp_ros.guidance.safety.unseen import PEEP, is_clear_of_unseen, watches_unseen
from cmpsp_ros.guidance.safety.validation import TOUCHING, Validation, Validator
from cmpsp_ros.guidance.settings import LawSettings
from cmpsp_ros.guidance.times import NANOSECONDS
from cmpsp_ros.guidance.world import World
from cmpsp_ros.robots.motion import braking, least_scale, speeds_and_turns
from cmpsp_ros.world import FreeSpace
from cmpsp_ros.world.grids import Cell, GridObstacle, OccupancyGrid, is_free
from cmpsp_ros.world.roads import OpenFloor

_SPEEDS: Final = (1.0, 0.75, 0.5, 0.25, 0.0)
_NEARLY: Final = 0.98  # part of a limit of speed that rounding leaves below it
_OF_MARGIN: Final = 0.2
"""Part of `safety.margin` that wheels which lag must keep: lags between those tried may lead a
little nearer to something."""

_SLOW: Final = 0.5  # speed below which errors of prediction shrink with it [m/s]
STANDSTILL: Final = 0.02  # speed below which the robot may as well stand [m/s]
_SOME_CELLS: Final = 4.0  # cells by which the grid looked at exceeds what a path can touch
_UNSEEN: Final = 'unseen'  # name of space that no sensor has seen yet, among the names of obstacles


class Contact(NamedTuple):
    """First obstacle that a plan leads into."""

    name: str
    distance: float  # lower bound of the distance to it along the plan [m]
    speed: float  # maximum speed with which the robot can still stop before it [m/s]

    def __str__(self) -> str:
        if self.name == _UNSEEN:
            return f'What is {self.distance:.2g} m ahead has not been seen yet.'
        return f'{self.name} is {self.distance:.2g} m ahead, and no plan passes it.'


class Conditions(NamedTuple):
    """All that a plan must be clear under."""

    start: PlanStart
    pending: Validation | None  # verdict on the path to the start, if there is one
    here: PlanStart  # the present state
    risk: Risk  # other responses of the robot


class Approach:
    """Slows plans down before obstacles that they lead into."""

    def __init__(self, settings: LawSettings, validator: Validator) -> None:
        self._validator = validator
        self._lag_validator = validator.with_margin(_OF_MARGIN * settings.safety.margin)
        self._settings, self._max_change = settings, settings.max_wheel_change
        # The last answer: a step asks twice about the same plan.
        self._calmed: tuple[Plan, Validation, tuple[Plan, Validation] | None] | None = None

    def contact(
        self, plan: Plan, start: PlanStart, worst_margin: float = -math.inf
    ) -> Contact | None:
        """First static obstacle that a plan leads into, except one that it begins in; None if none.

        Where the wheels take a while to stop, that is part of the plan. `worst_margin` [m].
        """
        is_clear = worst_margin >= -TOUCHING and self._max_change == math.inf
        if is_clear and self._seen(start.world) is None:
            return None
        found = None
        for controls, durations in self._to_rest(plan, start):
            hit, step = self._first_hit(start, controls, durations)
            if hit is None:
                return None
            found = found or hit
            if step < len(plan.horizon.durations):
                break
        return found

    def end_speed(self, plan: Plan, ahead: Contact) -> float:
        """Maximum speed at the end of a plan to stop before a contact behind it [m/s]; else inf."""
        speeds = speeds_and_turns(self._settings.robot.twist(plan.controls[:-1]))[:, 0]
        room = ahead.distance - float(np.abs(speeds) @ plan.horizon.durations)
        if room < 0.0:
            return math.inf
        return self._speed(room, self._settings.control_period)

    def _first_hit(
        self, start: PlanStart, controls: Array, durations: Array
    ) -> tuple[Contact | None, int]:
        """First contact along a path, and index of its step."""
        poses, twists = (
            start.robot.roll_out(start.pose, controls, durations),
            start.robot.twist(controls),
        )
        world = start.world
        spaces = [world.free_space(self._settings)]
        if (seen := self._seen(world)) is not None:
            spaces.append(self._sight(world, seen.grid, poses))
        names = (*world.names, '', '', _UNSEEN)
        begins = np.hstack([each.at(poses[:1], start.progress)[0] for each in spaces])
        swept = np.hstack(
            [each.along(poses[:-1], twists, durations, start.progress) for each in spaces]
        )
        hits = (swept < -TOUCHING) & (begins >= -TOUCHING)
        if not hits.any():
            return None, len(durations)
        step = int(hits.any(axis=1).argmax())
        what = int(np.where(hits[step], swept[step], np.inf).argmin())
        # As near as it came to it before, it is at least as far away where that arc begins.
        before = begins[what] if step == 0 else swept[step - 1, what]
        speeds = np.abs(speeds_and_turns(twists[: step + 1])[:, 0])
        distance = float((speeds[:step] * durations[:step]).sum())
        # Of a robot that turns some discs are faster than its reference point.
        fastest = abs(self._settings.footprint.speeds_and_turns(twists[step : step + 1])[0, 0])
        ratio = float(speeds[step] / fastest) if fastest > 0.0 else 1.0
        distance += ratio * max(float(before), 0.0)
        return Contact(names[what], distance, self._speed(distance, float(durations[0]))), step

    def before(self, obstacles: Mapping[str, float], start: PlanStart) -> Contact:
        """Contact with the nearest of some obstacles, by their distances [m]."""
        space = start.world.free_space(self._settings)
        clearance = dict(
            zip(start.world.names, space.at(start.pose[None], start.progress)[0], strict=True)
        )
        away = {f'obstacle {name}': along for name, along in obstacles.items()}
        distances = {name: max(float(clearance[name]), along, 0.0) for name, along in away.items()}
        name = min(distances, key=distances.__getitem__)
        return Contact(
            name, distances[name], self._speed(distances[name], self._settings.control_period)
        )

    def limited(
        self, plan: Plan, verdict: Validation, ahead: Contact | None, under: Conditions
    ) -> tuple[Plan, Validation, str] | None:
        """A plan slowed to a safe speed, with verdict and remark; None if none is safe."""
        remark, start = '', under.start
        slowed = None if ahead is None else self.slowed(plan, start, ahead.speed)
        if slowed is not None:
            durations = slowed.horizon.durations
            checked = self._validator.check(start, slowed.controls, durations, under.pending)
            if checked.passed:
                plan, verdict = slowed, checked
                remark = f' Slows down to {self._speed_of(plan):.3g} m/s: {ahead}'
        calm = self.calmed(plan, verdict, under)
        if calm is None:
            return None
        if calm[0] is not plan:
            why = verdict.reason or under.risk.remark
            if not verdict.reason and not self._sees_enough(plan, verdict.ramp, start):
                why = 'something could come from where no sensor looks.'
            remark += f' Slowed to {self._speed_of(calm[0]):.3g} m/s: {why}'
        return (*calm, remark)

    def _speed_of(self, plan: Plan) -> float:
        return _speed(self._settings.robot.twist(plan.controls[0]))

    def slowed(self, plan: Plan, start: PlanStart, speed: float) -> Plan | None:
        """Plan scaled in time to a speed, as far as the wheels follow; None if it is no faster."""
        driven = _speed(start.robot.twist(plan.controls[0]))
        return None if driven <= speed else self.scaled(plan, start, speed / driven)

    def scaled(self, plan: Plan, start: PlanStart, scale: float) -> Plan:
        """A plan with all its commands scaled alike, as far as the wheels can follow."""
        limit = self._settings.max_wheel_change
        paced = start.robot.time_scaling
        first, previous = plan.controls[0], start.previous_control
        scale = max(scale, least_scale(first, previous, limit, paced))
        if (jolt := self._settings.max_second_difference) < math.inf:
            scale = max(scale, least_scale(first, previous + start.previous_change, jolt, paced))
        controls = start.robot.slowed(plan.controls, scale)
        poses = start.robot.roll_out(start.pose, controls, plan.horizon.durations)
        return plan._replace(controls=controls, poses=poses)

    def calmed(
        self, plan: Plan, verdict: Validation, under: Conditions
    ) -> tuple[Plan, Validation] | None:
        """A plan slow enough for every response, with its verdict; None if none is."""
        if self._calmed is not None and self._calmed[0] is plan and self._calmed[1] is verdict:
            return self._calmed[2]
        calm = self._calm(plan, verdict, under)
        self._calmed = plan, verdict, calm
        return calm

    def _calm(
        self, plan: Plan, verdict: Validation, under: Conditions
    ) -> tuple[Plan, Validation] | None:
        start, pending, here, risk = under
        watches = start.world.seen is not None and watches_unseen(self._settings, start)
        if verdict.passed and not risk.responses and not watches:
            return plan, verdict
        # The margin is there for errors: plans keep it, and nothing asks for more.
        error = min(risk.error, (1.0 - _OF_MARGIN) * self._settings.safety.margin)
        for fraction in self._fractions(plan, creeps=watches or not verdict.passed):
            slower, checked = plan, verdict
            if fraction < 1.0:
                slower = self.scaled(plan, start, fraction)
                durations = plan.horizon.durations
                checked = self._validator.check(start, slower.controls, durations, pending)
            if not checked.passed or not self._sees_enough(slower, checked.ramp, start):
                continue
            asked = error * self._part_of_error(slower, fraction) if risk.responses else 0.0
            if all(
                self._lag_validator.is_clear_with(each, here, slower, checked.ramp, asked)
                for each in risk.responses
            ):
                return slower, checked
        return None

    def _part_of_error(self, plan: Plan, fraction: float) -> float:
        """Part of an error to stay clear by: what is slow errs less, and must get out of gaps."""
        slow = min(_SLOW, self._settings.pace)
        if self._speed_of(plan) >= slow:
            return fraction
        twist = self._settings.robot.twist(plan.controls[:1])
        fastest = abs(float(self._settings.footprint.speeds_and_turns(twist)[0, 0]))
        return min(fraction, fastest / slow)

    def _fractions(self, plan: Plan, *, creeps: bool) -> Iterator[float]:
        """Fractions of a plan's speed that are tried, with that of creeping where it may do."""
        yield from _SPEEDS[:-1]
        speed, slowest = self._speed_of(plan), _SPEEDS[-2]
        if self._settings.safety.stop_within_sight == 'moving' and speed > 0.0:
            yield min(PEEP / speed, slowest)
        if creeps and speed > 0.0:
            yield min(_NEARLY * CREEP / speed, slowest)
        yield _SPEEDS[-1]

    def _sees_enough(self, plan: Plan, ramp: Array, start: PlanStart) -> bool:
        """True if nothing out of sight matters, or can reach the robot before it is at rest."""
        if start.world.seen is None or not watches_unseen(self._settings, start):
            return True
        path = np.vstack([plan.controls[:1], ramp.reshape(-1, plan.controls.shape[1])])
        held = [self._settings.control_period] * (len(path) - 1)
        durations = np.append(plan.horizon.durations[:1], held)
        delay = plan.delay / NANOSECONDS
        return is_clear_of_unseen(self._settings, start, path, durations, delay)

    def _seen(self, world: World) -> GridObstacle | None:
        """Seen grid, if the robot must be able to stop within it."""
        return None if self._settings.safety.stop_within_sight == 'off' else world.seen

    def _sight(self, world: World, grid: OccupancyGrid, poses: Array) -> FreeSpace:
        """Known space around a path ``(K, 3)``, up to the first unknown place on it."""
        points, footprint = poses[:, :2], self._settings.footprint
        radius = self._settings.robot_radius
        known = grid.at(points)
        if world.map is not None:
            known = np.where(known == Cell.UNKNOWN, world.map.grid.at(points), known)
        beyond = np.append(~is_free(known), True).argmax() + 1
        longest = float(np.hypot(*np.diff(points[:beyond], axis=0).T).max(initial=0.0))
        reach = radius + footprint.reach + longest + _SOME_CELLS * grid.resolution
        near = grid.around(points[:beyond], reach)
        if world.map is not None:
            near = near.completed_by(world.map.grid)
        return FreeSpace.of(OpenFloor(), (GridObstacle(_UNSEEN, near),), radius, footprint.discs)

    def _to_rest(self, plan: Plan, start: PlanStart) -> Iterator[tuple[Array, Array]]:
        """Commands of a plan, until the robot is at rest at the latest, and their durations."""
        settings = self._settings
        controls, durations = plan.controls[:-1], plan.horizon.durations
        period, limit = settings.control_period, self._max_change
        if limit == math.inf:
            yield controls, durations
            return
        late, paced = np.array([settings.safety.stopping_time]), settings.robot.time_scaling
        ramp = braking(plan.controls[-2:], late, period, limit, paced, along=False)
        yield self._ending(plan, ramp)
        if start.world.road.has_center_line:
            end = start._replace(pose=plan.poses[-1])
            lasting = late.item(0), period, limit
            for each in brakings_on_road(end, controls[-1], *lasting):
                yield self._ending(plan, each)

    def _ending(self, plan: Plan, ramp: Array) -> tuple[Array, Array]:
        settings, controls = self._settings, plan.controls[:-1]
        held = np.full(len(ramp), settings.control_period)
        late = [settings.safety.stopping_time]
        durations = np.concatenate([plan.horizon.durations, late, held])
        return np.vstack([controls, controls[-1:], ramp]), durations

    def _speed(self, distance: float, period: float) -> float:
        """The largest with which the robot, after a control period more, can stop in a distance."""
        settings, robot = self._settings, self._settings.robot
        time = period + settings.safety.stopping_time
        room = max(distance - settings.safety.margin, 0.0)
        braking = robot.braking
        # The root of speed * time + speed^2 / (2 * braking) = room.
        return 2.0 * room / (time + math.sqrt(time * time + 2.0 * room / braking))


def _speed(twist: Array) -> float:
    return abs(float(speeds_and_turns(twist)[0]))
