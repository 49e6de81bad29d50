"""Recorded decisions: what the guidance node says it did."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cmpsp_ros.bags.errors import BagError
from cmpsp_ros.bags.reader import Bag
from cmpsp_ros.bags.recording import Recorded
from cmpsp_ros.guidance.goals import Goal

Array = NDArray[np.float64]

_LATEST = 1 << 62
"""In the year 2116 [ns]; what is later fits no array of stamps."""


@dataclass(frozen=True)
class Said:
    """One message of `~/decision`.

    Attributes:
        received: When it was received [ns].
        stamp: Stamp of the odometry that it answers, or time of a stop without odometry [ns].
        step: Number of the control step in its run.
        run: How often the law had been reset before it; 0 where that was not recorded.
        revision: How often the law had been given new settings; 0 where that was not recorded.
        rung: FallbackLevel of the ladder, in lower case.
        reason: Why, in a sentence.
        finished: Whether the final time had passed.
        halted: Whether it answers no odometry.
        wheel_speeds: Right and left wheel [rad/s], shape ``(2,)``.
        step_ms: Time from odometry to command [ms]; None where it was not measured.
        goal: What it drives to, where it says so.
        told: How many goals had been told since the run began.
    """

    received: int
    stamp: int
    step: int
    run: int
    revision: int
    rung: str
    reason: str
    finished: bool
    halted: bool
    wheel_speeds: Array
    step_ms: float | None
    goal: Goal | None = None
    told: int = 0


def read_decisions(bag: Bag, topic: str) -> tuple[Said, ...]:
    """Decisions of a topic, in order; none where the bag lacks the topic.

    Raises:
        BagError: A message is no decision of this package.
    """
    if topic not in bag.topics:
        return ()
    source = f'{bag.path}: {topic}'
    return tuple(_said(source, received, message) for received, message in bag.messages(topic))


def wheel_speeds(decisions: Sequence[Said]) -> Array:
    """Right and left wheel of each, shape ``(D, 2)`` [rad/s]."""
    return np.array([each.wheel_speeds for each in decisions]).reshape(-1, 2)


def _said(source: str, received: int, message: Any) -> Said:
    found = Recorded.of(source, received, message)
    if not 0 <= found.stamp <= _LATEST:
        raise BagError(f'{source}: found a stamp of {found.stamp} ns, wanted one of a clock')
    wheels = [found.number(f'wheel_speed_{side}') for side in ('right', 'left')]
    return Said(
        received=received,
        stamp=found.stamp,
        step=found.step,
        run=found.run or 0,
        revision=found.revision or 0,
        rung=found.text('rung'),
        reason=found.reason,
        finished=found.finished,
        halted=found.halted,
        wheel_speeds=np.array(wheels),
        step_ms=found.number('step_ms') if 'step_ms' in found.facts else None,
        goal=_goal(found),
        told=found.told,
    )


def _goal(found: Recorded) -> Goal | None:
    if 'goal' not in found.facts:
        return None
    position = found.number('goal_x'), found.number('goal_y')
    heading = found.number('goal_heading') if 'goal_heading' in found.facts else None
    return Goal(position, found.number('goal_time'), heading, found.text('goal'))
