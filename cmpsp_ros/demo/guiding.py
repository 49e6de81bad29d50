"""Robots that set out, and are followed to their end."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Final

from cmpsp_ros.demo.errors import DemoError
from cmpsp_ros.demo.processes import Child, check_all
from cmpsp_ros.demo.scenario import Scenario
from cmpsp_ros.guidance import is_at_rest

if TYPE_CHECKING:
    from cmpsp_ros.nodes import GuidanceStatus, LifecycleClient

START_TIMEOUT: Final = 30.0
"""Time within which a node of one robot changes its state [s]."""

_STALL_TIMEOUT: Final = 15.0
_PATIENCE: Final = 2.0
"""Time after which it is said what a run waits for [s]."""


def guide(
    observer: LifecycleClient,
    children: Sequence[Child],
    robots: Sequence[Scenario],
    notice: Callable[[Scenario, GuidanceStatus], None],
    apart: float = 0.0,
) -> None:
    """Have the robots set out, and follow them up to the decisions that their time has passed.

    Args:
        observer: As from `started`.
        children: As from `started`.
        robots: What runs.
        notice: Called with each decision.
        apart: Time between one robot's setting out and the next one's [s].

    Raises:
        DemoError: A node cannot be activated, has ended, or decides no more.
    """
    named = {each.namespace: each for each in robots}
    heard: dict[str, float] = {}
    activated: dict[str, float] = {}
    begun, said = set[str](), set[str]()

    def on_decision(namespace: str, seen: GuidanceStatus) -> None:
        heard[namespace] = time.monotonic()
        if seen.decision['halted'] == 'false':
            begun.add(namespace)
        notice(named[namespace], seen)

    def is_over() -> bool:
        check_all(children)
        now = time.monotonic()
        for namespace, seen in observer.robots.items():
            whose = f' of {namespace}' if namespace else ''
            waited = 0.0 if namespace in begun else now - activated[namespace]
            if waited > _STALL_TIMEOUT:
                why = f'the run{whose} did not begin within {_STALL_TIMEOUT:.0f} s'
                raise DemoError(f'{why}: {_reason_to_wait(named[namespace], seen)}')
            if waited > _PATIENCE and namespace not in said:
                said.add(namespace)
                why = f'the run{whose} has not begun yet'
                sys.stderr.write(f'{why}: {_reason_to_wait(named[namespace], seen)}\n')
            if now - heard[namespace] > _STALL_TIMEOUT:
                raise DemoError(
                    f'no decision{whose} for {_STALL_TIMEOUT:.0f} s; the last was: {seen.reason}'
                )
        decisions = {each: seen.decision for each, seen in observer.robots.items()}
        # The one that the clock has made is followed by one that judges where the robot was, and
        # that one by others until the robot is at rest.
        wanted = {'finished': 'true', 'halted': 'false'}
        return all(
            wanted.items() <= decision.items() and is_at_rest(decision, named[each].settings.robot)
            for each, decision in decisions.items()
        )

    observer.on_decision = on_decision
    for robot, node in zip(robots, children[-len(robots) :], strict=True):
        activate = partial(observer.activate, START_TIMEOUT * len(robots), robot.namespace)
        node.ask('cannot be activated', activate)
        activated[robot.namespace] = time.monotonic()
        heard.setdefault(robot.namespace, activated[robot.namespace])
        observer.wait_until(lambda: False, apart)
    observer.wait_until(is_over, math.inf)


def _reason_to_wait(robot: Scenario, seen: GuidanceStatus) -> str:
    """Why a run has not begun, with the topic of a sensor that is waited for."""
    why = seen.reason or seen.message or 'Guidance says nothing.'
    topics = {each: robot.values[f'sensors.{each}.topic'] for each in robot.values['sensors.names']}
    silent = [f'Sensor {name} listens to {topic}.' for name, topic in topics.items() if name in why]
    return ' '.join([why, *silent])
