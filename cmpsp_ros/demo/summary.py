"""Figures of a run."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from cmpsp_ros.bags import BagError, DecisionRecord, runs
from cmpsp_ros.demo.scenario import Scenario
from cmpsp_ros.guidance import FallbackLevel, GuidanceSettings, to_nanoseconds

# Part of the speed along a road by which its mean may be off.
_SPEED_TOLERANCE = 0.02


@dataclass(frozen=True)
class Summary:
    """Figures of a run between its first decision and its final time."""

    preset: str  # name of the preset or parameter file
    # True if every goal was passed within its tolerances at its time; for a followed road, if the
    # mean speed was reached.
    reached: bool
    miss: float | None  # distance from the goal at the final time [m]; None for a followed road
    # Minimum clearance of the driven path, also between samples, from road edges and obstacles, and
    # while the robot moves from moving obstacles, less the robot's radius [m].
    clearance: float
    max_wheel_speed: float  # maximum wheel speed driven [rad/s]
    # Median, 99th percentile and maximum from odometry to command [ms]; None if not measured.
    step_times: dict[str, float | None]
    deadline_misses: int  # control steps whose command was sent too late, or not at all
    levels: dict[str, int]  # control steps at each fallback level
    control_steps: int  # number of control steps
    passings: tuple[runs.Passing, ...] = ()  # passing of each goal, in order, if there are several
    speed: float | None = None  # mean speed along a followed road [m/s]
    # Why the run was given up, or else the reason of the first step at the worst fallback level; ''
    # if all were nominal.
    reason: str = ''
    not_judged: str = ''  # missing recordings, in words; '' if none
    apart: float = math.inf  # least distance from any other robot of the run [m]

    @property
    def has_failed(self) -> bool:
        """True if it failed for certain."""
        missed = not self.reached and (self.speed is not None or self.miss is not None)
        return missed or self.clearance < 0.0 or self.apart < 0.0

    @property
    def failure(self) -> str:
        """Why the run failed, or cannot be judged, in words; empty if it did not."""
        reasons = []
        if not self.reached and self.speed is not None:
            reasons.append(f'the road was followed at {self.speed:.3g} m/s')
        elif not self.reached and self.passings:
            worst = max(self.passings, key=lambda each: each.ratio)
            reasons.append(f'the robot passed {worst}')
        elif not self.reached and self.miss is not None:
            reasons.append(f'the goal was missed by {self.miss:.3g} m')
        if self.clearance < 0.0:
            reasons.append(f'the path cut road edge or obstacle by {-self.clearance:.3g} m')
        if self.apart < 0.0:
            reasons.append(f'the robot touched another by {-self.apart:.3g} m')
        if self.not_judged:
            reasons.append(f'not judged: {self.not_judged}')
        failure = ' and '.join(reasons)
        return f'{failure}; guidance said: {self.reason}' if failure and self.reason else failure

    def values(self) -> dict[str, Any]:
        """The figures by name and unit."""
        values: dict[str, Any] = {
            'preset': self.preset,
            'reached': self.reached,
            'miss_m': self.miss,
            'clearance_m': self.clearance,
            'max_wheel_speed_rad_s': self.max_wheel_speed,
            'step_ms': self.step_times,
            'deadline_misses': self.deadline_misses,
            'levels': self.levels,
            'control_steps': self.control_steps,
        }
        if self.passings:
            values['goals'] = [
                {
                    'name': each.goal.name,
                    'time_s': each.goal.time,
                    'miss_m': each.miss,
                    'heading_miss_rad': each.heading_miss,
                }
                for each in self.passings
            ]
        if self.speed is not None:
            values['speed_m_s'] = self.speed
        if self.not_judged:
            values['not_judged'] = self.not_judged
        return values


def final_time(run: runs.Run, settings: GuidanceSettings) -> float:
    """The final time [s]; if it may be postponed, that of the last decision."""
    goals = [each.goal for each in run.decisions if each.goal is not None]
    return goals[-1].time if settings.moves_final_time and goals else settings.final_time


def window(run: runs.Run, settings: GuidanceSettings) -> tuple[int, int]:
    """First odometry that was decided on, and the final time, as stamps [ns]."""
    # Before it the node may have had to wait, for a sensor perhaps.
    answers = (each.stamp for each in run.decisions if not each.halted)
    first = next(answers, run.decisions[0].stamp)
    last = first + to_nanoseconds(settings.final_time)
    begin, end = int(run.driven.stamps[0]), int(run.driven.stamps[-1])
    if not begin <= first < last <= end:
        raise BagError(
            f'the path driven is recorded from {begin} to {end} ns, wanted {first} to {last} ns'
        )
    return first, last


def summarise(run: runs.Run, settings: GuidanceSettings, preset: str) -> Summary:
    """Figures of a recorded run."""
    first, last = window(run, settings)
    driven, lifetime_of = run.driven.between(first, last), partial(runs.lifetime, settings=settings)
    interval = runs.longest_interval(run.driven.stamps, settings)
    begin, end = int(run.driven.stamps[0]), int(run.driven.stamps[-1])
    unknown = [
        each
        for each in runs.holes(run.driven.stamps, begin, end, interval)
        if runs.overlaps((first, last), [each])
    ]
    nearest: list[float] = []
    met: list[runs.Encounter] = []
    for part in runs.pieces(run.driven, first, last, interval):
        clearance = settings.world.clearance(
            settings, part.poses[:-1], part.twists[:-1], part.durations
        )
        nearest.append(float(clearance.min()))
        for tracks in (run.tracks if not run.people else run.told, run.people):
            met += runs.encounters(part, tracks, settings.bodies, lifetime_of)
    nearest += [float(clearance.min()) for _, clearance in runs.driven_into(met)]
    passings = []
    # Goals at their times; where these are not those of the settings, of the last decisions.
    led = runs.goals_driven_to(run.decisions, settings) if settings.is_soonest else []
    for goal in list({goal.name: goal for _, goal in led}.values()) or settings.goals:
        stamp = first + to_nanoseconds(goal.time)
        if not runs.is_within(stamp, unknown):
            passings.append(runs.Passing.of(settings, goal, stamp, run.driven.at(stamp)))
    speed, follow = None, settings.follow
    if follow is not None:
        speed = runs.mean_speed(settings, driven.poses, settings.final_time)
        reached = abs(speed - follow.speed) <= _SPEED_TOLERANCE * abs(follow.speed)
    else:
        reached = all(each.ratio <= 1.0 for each in passings)
        reached &= len(passings) == len(settings.goals)
    inside = (run.wheel_stamps >= first) & (run.wheel_stamps <= last)
    steps = [each for each in run.decisions if first <= each.stamp < last]
    times = [each.step_ms for each in steps if each.step_ms is not None]
    p50, p99, longest = np.percentile(times, [50, 99, 100]).tolist() if times else (None,) * 3
    counts = Counter(each.level for each in steps)
    return Summary(
        preset=preset,
        reached=reached,
        miss=passings[-1].miss if passings else None,
        clearance=min(nearest, default=np.inf),
        max_wheel_speed=float(np.abs(run.wheel_speeds[inside]).max(initial=0.0)),
        step_times={'p50': p50, 'p99': p99, 'max': longest},
        deadline_misses=sum(
            each.misses_deadline(settings.control_period, settings.command_delay) for each in steps
        ),
        levels={each.name.lower(): counts[each.name.lower()] for each in FallbackLevel},
        control_steps=len(steps),
        passings=tuple(passings) if len(passings) > 1 or settings.goal_heading is not None else (),
        speed=speed,
        reason=_reason(run, steps),
        not_judged=f'the path is not recorded {runs.in_words(unknown, first)}' if unknown else '',
    )


def nearest_robot(number: int, fleet: Sequence[Scenario], recorded: Sequence[runs.Run]) -> float:
    """Least distance of a robot from any other until its final time, also between samples [m]."""
    own, run, apart = fleet[number], recorded[number], math.inf
    first, last = window(run, own.settings)
    longest = runs.longest_interval(run.driven.stamps, own.settings)
    for path in runs.pieces(run.driven, first, last, longest):
        for other, its in zip(fleet, recorded, strict=True):
            others = {} if other is own else {other.namespace: its.driven}
            timeout = own.settings.moving_obstacles.timeout
            around = other.settings.circumscribed_radius, own.settings.bodies, timeout
            for each in runs.robot_encounters(path, others, *around):
                apart = min(apart, float(each.clearance.min()))
    return apart


def _reason(run: runs.Run, steps: Sequence[DecisionRecord]) -> str:
    """Why the run was given up, or else the reason of the first step at the worst level."""
    if why := next(filter(None, (each.why_given_up for each in run.decisions)), ''):
        return why
    levels = [level.name.lower() for level in FallbackLevel]
    # The first step may be a stop by design, while the first plan is made.
    worst = max(steps[1:] or steps, key=lambda each: levels.index(each.level), default=None)
    return '' if worst is None or worst.level == levels[0] else worst.reason
