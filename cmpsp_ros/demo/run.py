"""One run: start simulator, guidance and recorder, watch them, stop them, sum up."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from cmpsp_ros.bags.run import read_run
from cmpsp_ros.demo.errors import DemoError
from cmpsp_ros.demo.pictures import draw_trajectory, draw_wheel_speeds
from cmpsp_ros.demo.processes import Child, use_free_domain
from cmpsp_ros.demo.scenario import Scenario
from cmpsp_ros.demo.summary import Summary, summarise
from cmpsp_ros.nodes.observer import Observer
from cmpsp_ros.parameters.presets import write_parameter_file

_START_TIMEOUT = 30.0
_STALL_TIMEOUT = 15.0
_SETTLE = 0.7

_RECORDED = (
    '/odom',
    '/cmd_vel',
    '/sim/truth',
    '/sim/wheel_speeds',
    '/guidance/decision',
    '/guidance/predicted_path',
    '/guidance/wheel_speeds',
    '/guidance/markers',
)


def run(
    scenario: Scenario,
    folder: Path,
    progress: Callable[[float], None],
    view_port: int | None = None,
) -> Summary:
    """Make one run and keep everything of it in a folder.

    Args:
        scenario: What to run.
        folder: Existing folder for bag, pictures, figures and logs.
        progress: Told the time of the run so far [s], again and again.
        view_port: Port of a page that shows the run, live; without it there is none.

    Returns:
        Its figures; they are also in `summary.json`.

    Raises:
        DemoError: A node failed, or the run came to no end.
        BagError: The recording does not cover the run.
    """
    write_parameter_file(folder / 'parameters.yaml', scenario.values)
    _drive(scenario, folder, progress, view_port)
    recorded = read_run(folder / 'bag')
    summary = summarise(recorded, scenario.settings, scenario.name)
    summary.write(folder / 'summary.json')
    draw_trajectory(recorded, scenario.settings, folder / 'trajectory.png')
    draw_wheel_speeds(recorded, scenario.settings, folder / 'wheel_speeds.png')
    return summary


def _drive(
    scenario: Scenario, folder: Path, progress: Callable[[float], None], view_port: int | None
) -> None:
    children: list[Child] = []
    with Observer(use_free_domain()) as observer:
        try:
            for name, arguments in _nodes(scenario, folder, view_port):
                children.append(Child.start(name, arguments, folder))
            _get_ready(observer, children, scenario)
            _watch(observer, children, scenario, progress)
        finally:
            # Guidance first, so that its last zero twist is still driven, recorded and shown.
            for child in reversed(children):
                child.stop()


def _nodes(
    scenario: Scenario, folder: Path, view_port: int | None
) -> Iterator[tuple[str, list[str]]]:
    """Modules of the nodes to start, in order, and what follows `--ros-args`."""
    clock = f'use_sim_time:={str(bool(scenario.values["publish_clock"])).lower()}'
    parameters = str(folder / 'parameters.yaml')
    if view_port is not None:
        yield 'viewer', ['-p', f'port:={view_port}']
    yield 'recorder', ['-p', f'output:={folder / "bag"}', '-p', clock]
    yield 'sim_node', ['--params-file', parameters]
    yield 'guidance_node', ['--params-file', parameters, '-p', clock]


def _get_ready(observer: Observer, children: list[Child], scenario: Scenario) -> None:
    """Wait until nothing of the run can be missed, and activate the guidance node."""
    moving = ('/moving_obstacles',) if scenario.values['moving_obstacles.names'] else ()

    def is_recorded() -> bool:
        for child in children:
            child.check()
        # Simulator and recorder must be known to the command's publisher itself.
        listeners = int(observer.seen.health.get('command_subscribers', 0))
        return listeners >= 2 and observer.is_recorded((*_RECORDED, *moving))

    guidance = children[-1]
    try:
        if not observer.configure(_START_TIMEOUT):
            raise DemoError(f'the guidance node refuses to start:\n{guidance.last_words()}')
        if not observer.wait_until(is_recorded, _START_TIMEOUT):
            raise DemoError(f'the nodes did not find each other within {_START_TIMEOUT:.0f} s')
        # The recorder is known here; whom it records may hear of it a little later.
        observer.wait_until(lambda: False, _SETTLE)
        if not observer.activate(_START_TIMEOUT):
            raise DemoError(f'the guidance node cannot be activated:\n{guidance.last_words()}')
    except TimeoutError as error:
        guidance.check()
        raise DemoError(f'{error}; it said:\n{guidance.last_words()}') from None


def _watch(
    observer: Observer,
    children: list[Child],
    scenario: Scenario,
    progress: Callable[[float], None],
) -> None:
    """Follow the decisions up to the one that says that the final time has passed."""
    final_time = scenario.settings.final_time
    latest, since = '', time.monotonic()

    def is_over() -> bool:
        nonlocal latest, since
        for child in children:
            child.check()
        decision = observer.seen.decision
        if decision and decision['stamp'] != latest:
            latest, since = decision['stamp'], time.monotonic()
            progress(final_time - float(decision['time_left']))
        if time.monotonic() - since > _STALL_TIMEOUT:
            raise DemoError(
                f'no decision for {_STALL_TIMEOUT:.0f} s;'
                f' the last was: {observer.seen.reason or "none"}'
            )
        return decision.get('finished') == 'true'

    observer.wait_until(is_over, math.inf)
