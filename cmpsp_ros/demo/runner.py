"""One run: start simulator, guidance and recorder, monitor and stop them, summarise.

The nodes take a second to start, so the modules that monitor them are imported after that, and
those that summarise while the nodes get ready.
"""

from __future__ import annotations

import math
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Final

from cmpsp_ros.demo.processes import Child, DemoError, check_all, stop_all, use_free_domain
from cmpsp_ros.demo.scenario import Scenario
from cmpsp_ros.guidance import is_at_rest
from cmpsp_ros.nodes.recording import Written
from cmpsp_ros.parameters.files import write_fleet_file, write_parameter_file

if TYPE_CHECKING:
    from cmpsp_ros.demo.summary import Summary
    from cmpsp_ros.nodes import GuidanceStatus, LifecycleClient

START_TIMEOUT: Final = 30.0  # time in which a node of one robot changes its state [s]
_STALL_TIMEOUT: Final = 15.0
_PATIENCE: Final = 2.0  # time after which it is said what a run waits for [s]


def guide(
    observer: LifecycleClient,
    children: Sequence[Child],
    robots: Sequence[Scenario],
    notice: Callable[[Scenario, GuidanceStatus], None],
    apart: float = 0.0,
) -> None:
    """Activate the robots, `apart` seconds from each other, and follow them to their ends.

    Observer and children are those of `started`; `notice` is called with each decision.
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
    if silent and not robot.values['sim.scan.rate']:
        silent.append('The simulator has no scanner: sim.scan.rate is 0.')
    return ' '.join([why, *silent])


_DELIVERY_TIMEOUT, _ASK_AGAIN = 15.0, 0.1

_RECORDER = 'recorder'

_RESULTS = 'cmpsp_ros.demo.results'  # module that is imported while the nodes get ready
# Topics that a simulator publishes again and again.
_PUBLISHED = ('/odom', '/sim/truth', '/sim/wheel_speeds')
# Subscriber counts in the guidance node's diagnostics: of topics that simulator or observer hear,
# and of those that the live page hears.
_HEARD: Final = {'command_subscribers', 'decision_subscribers'}
_VIEWED: Final = {'decision_subscribers', 'path_subscribers', 'sighting_subscribers'}


def run(
    robots: Sequence[Scenario],
    folder: Path,
    progress: Callable[[float], None],
    view_port: int | None = None,
) -> tuple[Summary, ...]:
    """Make one run of a robot, or of several with namespaces, and keep its results in a folder.

    Progress is called with the time of the run so far [s]; a page on `view_port` shows the
    first robot. Returns the figures of each; raises BagError if the recording does not cover
    the run.
    """
    path = folder / 'parameters.yaml'
    if len(robots) > 1:
        write_fleet_file(path, {each.namespace: each.values for each in robots})
    else:
        write_parameter_file(path, robots[0].values)

    def tell(robot: Scenario, seen: GuidanceStatus) -> None:
        progress(robot.settings.final_time - float(seen.decision['time_left']))

    with started(robots, folder, view_port) as (observer, children):
        guide(observer, children, robots, tell)
        for robot, node in zip(robots, children[-len(robots) :], strict=True):
            end = partial(observer.deactivate, START_TIMEOUT, robot.namespace)
            node.ask('cannot be deactivated', end)
        _wait_for_the_end(observer, children, robots)
        # The robots stand, and the bag has it: no node has anything to say to another any more.
        for child in children:
            child.interrupt()
        for child in children:
            if child.name == _RECORDER:
                if child.stop() != 0:
                    child.check()
                for warning in child.warnings():
                    sys.stderr.write(f'{child.name}: {warning}\n')
        # The bag is complete, and the other nodes end meanwhile.
        from cmpsp_ros.demo.results import sum_up  # noqa: PLC0415 (imported while they started)

        return sum_up(robots, folder)


@contextmanager
def started(
    robots: Sequence[Scenario], folder: Path, view_port: int | None = None, *, record: bool = True
) -> Iterator[tuple[LifecycleClient, Sequence[Child]]]:
    """Start and configure the nodes of one robot or several; all are stopped at the end.

    The folder has `parameters.yaml`, and gets bag and logs; a page on `view_port` shows the
    first robot.
    """
    children: list[Child] = []
    try:
        domain = use_free_domain()
        for name, arguments, namespace in _nodes(robots, folder, view_port, record=record):
            children.append(Child.start(name, arguments, folder, namespace))
        from cmpsp_ros.nodes import LifecycleClient  # noqa: PLC0415 (the nodes need longer)

        with LifecycleClient(domain, [each.namespace for each in robots]) as observer:
            if record:
                threading.Thread(target=import_module, args=[_RESULTS], daemon=True).start()
            is_viewed = view_port is not None
            _get_ready(observer, children, robots, record=record, is_viewed=is_viewed)
            yield observer, children
    finally:
        # Guidance first, so that its last zero twist is still driven, recorded and shown.
        stop_all(children)


def _nodes(
    robots: Sequence[Scenario], folder: Path, view_port: int | None, *, record: bool
) -> Iterator[tuple[str, list[str], str]]:
    """Modules of the nodes in the order of their start, their ROS arguments, and the namespace."""
    clock = f'use_sim_time:={str(bool(robots[0].values["publish_clock"])).lower()}'
    parameters = str(folder / 'parameters.yaml')
    if view_port is not None:
        yield 'viewer', ['-p', f'port:={view_port}'], robots[0].namespace
    if record:
        yield _RECORDER, ['-p', f'output:={folder / "bag"}', '-p', clock], ''
    for each in robots:
        yield 'sim_node', ['--params-file', parameters], each.namespace
    for each in robots:
        yield 'guidance_node', ['--params-file', parameters, '-p', clock], each.namespace


def _get_ready(
    observer: LifecycleClient,
    children: Sequence[Child],
    robots: Sequence[Scenario],
    *,
    record: bool,
    is_viewed: bool,
) -> None:
    """Configure the guidance nodes, and wait until all subscriptions of the run match."""
    timeout = START_TIMEOUT * len(robots)

    def is_heard() -> bool:
        check_all(children)
        for number, seen in enumerate(observer.robots.values()):
            # The page shows the first robot.
            viewed = _VIEWED if is_viewed and number == 0 else ()
            for key in {*_HEARD, *seen.health}:
                least = record + (key in _HEARD) + (key in viewed)
                if key.endswith('_subscribers') and int(seen.health.get(key, 0)) < least:
                    return False
        return True

    for each, node in zip(robots, children[-len(robots) :], strict=True):
        configure = partial(observer.configure, timeout, each.namespace, node.still_compiles)
        node.ask('refuses to start', configure)
    if not observer.wait_until(is_heard, timeout):
        raise DemoError(f'the nodes did not find each other within {timeout:.0f} s')
    if record:
        wanted = {topic: Written(1) for topic in _published(robots)}
        if lacking := _wait_for_bag(observer, children, wanted):
            raise DemoError(lacking)


def _wait_for_the_end(
    observer: LifecycleClient, children: Sequence[Child], robots: Sequence[Scenario]
) -> None:
    """Wait until every decision received is in the bag, with its command and inputs.

    The simulator continues: once a message that it publishes from now on is in the bag, all
    earlier ones are.
    """
    now = time.time_ns()
    decided = {
        f'{namespace}{topic}': Written(count)
        for namespace, seen in observer.robots.items()
        for topic, count in (
            ('/cmd_vel', seen.commands),
            ('/guidance/decision', seen.decisions),
            ('/guidance/wheel_speeds', seen.decisions),
        )
    }
    driven = {topic: Written(1, published=now) for topic in _published(robots)}
    # Lost messages do not arrive any more. The bag shows if the run can still be judged.
    if lacking := _wait_for_bag(observer, children, decided | driven):
        sys.stderr.write(f'{lacking}\n')


def _wait_for_bag(
    observer: LifecycleClient, children: Sequence[Child], wanted: Mapping[str, Written]
) -> str:
    """Wait until the bag has this number of messages of each topic, and none older."""
    end = time.monotonic() + _DELIVERY_TIMEOUT

    while True:
        try:
            found = observer.recorded(_DELIVERY_TIMEOUT, partial(check_all, children))
        except TimeoutError as error:
            raise DemoError(str(error)) from None
        lacking = [
            f'{topic}, of which it has {found[topic].count} messages'
            for topic, least in wanted.items()
            if found[topic].count < least.count or found[topic].published < least.published
        ]
        if not lacking or time.monotonic() > end:
            after = f'after {_DELIVERY_TIMEOUT:.0f} s the recorder lacks messages'
            return f'{after}: {"; ".join(lacking)}' if lacking else ''
        observer.wait_until(lambda: False, _ASK_AGAIN)


def _published(robots: Sequence[Scenario]) -> Iterator[str]:
    """Topics that the simulators publish periodically."""
    for each in robots:
        yield from (f'{each.namespace}{topic}' for topic in _PUBLISHED)
        if each.values['moving_obstacles.names']:
            yield f'{each.namespace}/moving_obstacles'
