"""Compilation of all kernels for later processes, and the work rate of the machine."""

import math
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, wait
from contextlib import ExitStack, closing
from dataclasses import dataclass
from functools import partial
from multiprocessing import connection, get_context, parent_process
from multiprocessing.queues import SimpleQueue
from pathlib import Path
from typing import Any, Final

import numpy as np

from cmpsp_ros.guidance import GuidanceSettings, prepare
from cmpsp_ros.mpsp import Options, from_functions, solve
from cmpsp_ros.mpsp.jit import (
    ProgressLine,
    compilations,
    entry_for,
    kernel_folder,
    prune,
    wanted_place,
)
from cmpsp_ros.mpsp.qp import CLARABEL, RICCATI_ACTIVE_SET, available
from cmpsp_ros.mpsp.qp.active_set import correct, empty_active_set, empty_warm_start
from cmpsp_ros.mpsp.qp.active_set import solve as solve_program
from cmpsp_ros.mpsp.qp.riccati import empty_program
from cmpsp_ros.parameters import TABLE, ParameterError, guidance_settings, load_parameter_file
from cmpsp_ros.parameters.files import preset_names, robots_in
from cmpsp_ros.sensing import Beams, LocalGrid
from cmpsp_ros.simulator import People, PeopleSettings, Walker, cast
from cmpsp_ros.world.grids import GridObstacle, small_groups


def new_pool(workers: int, *begin: Any) -> ProcessPoolExecutor:
    """Processes that ignore SIGINT and end with their parent; each calls `begin` first."""
    # A fork would copy the locks of the numerical libraries' threads.
    return ProcessPoolExecutor(workers, get_context('spawn'), partial(_begin, *begin))


def _begin(call: Callable[..., None] | None = None, *arguments: Any) -> None:
    if call is not None:
        call(*arguments)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    if parent is not None:
        threading.Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    # A worker whose parent was killed would wait for work for ever.
    connection.wait([sentinel])
    os._exit(1)


_GIGABYTE: Final = 1 << 30
_NEEDED: Final = 2  # memory that a process takes while it compiles [GB]
_POLL: Final = 0.2  # period of the reports of progress [s]
_reports: Final = ExitStack()


@dataclass(frozen=True)
class Part:
    """One part of the work."""

    name: str  # name of the part
    kernels: int  # number of kernels compiled for it
    seconds: float  # time it took [s]


@dataclass(frozen=True)
class Outcome:
    """Result of a warm-up."""

    folder: Path | None  # folder of the machine code; None if there is none
    parts: tuple[Part, ...]  # parts in the order run
    removed: tuple[Path, ...]  # stale files removed

    @property
    def hindrance(self) -> str:
        """Trouble with the folder in a sentence; empty when there is none."""
        wanted = wanted_place()
        if self.folder is not None and self.folder.parent == wanted:
            return ''
        instead = (
            'nothing would be kept'
            if self.folder is None
            else 'a restart of the machine may remove it'
        )
        return f'{wanted} is no folder that only you can write to: {instead} (NUMBA_CACHE_DIR).'


def warm_up_all(
    progress: Callable[[int, str], None] = lambda _count, _name: None, presets: Sequence[str] = ()
) -> Outcome:
    """Run everything that is compiled, and remove machine code unused for long.

    Kinds of roads and obstacles have code of their own, shared by processes. Without a folder for
    machine code nothing is run.

    Args:
        progress: Called with the number of kernels begun, and the one being compiled.
        presets: Presets or parameter files to compile for; all presets if empty.

    Raises:
        ParameterError: The presets cannot be read.
    """
    folder = kernel_folder()
    if folder is None:
        return Outcome(None, (), ())
    # The solver takes as long as all else that a road needs. The method comes last: most of its
    # code is the roads' too.
    work: dict[str, Callable[[], None]] = {'the solver': _solver}
    kinds = _kinds(presets)
    work |= {name: partial(_drive, each) for name, each in kinds.items()}
    if any(each.sight.sensors for kind in kinds.values() for each in kind):
        work['scans'] = _scans
    if not presets:
        work['the method'] = _method
    begun: SimpleQueue[str] = get_context('spawn').SimpleQueue()
    count, parts = 0, []
    pool = new_pool(min(_workers(), len(work)), _report_to, begun)
    try:
        left = {pool.submit(_do, name, task) for name, task in work.items()}
        while left:
            done, left = wait(left, _POLL)
            parts += [each.result() for each in done]
            while not begun.empty():
                count += 1
                progress(count, begun.get())
    finally:
        pool.shutdown(cancel_futures=True)
    return Outcome(folder, tuple(parts), tuple(prune(folder.parent, time.time())))


def main() -> None:
    """Compile for the presets in the command line, or everything; `make` has no `cmpsp` yet."""
    try:
        with closing(ProgressLine()) as line:
            warm_up_all(line.show, sys.argv[1:])
    except ParameterError as error:
        sys.exit(f'error: {error}')


def _report_to(begun: SimpleQueue[str]) -> None:
    """Send the names of kernels from this process, from now on."""
    _reports.enter_context(compilations(begun.put))


def _workers() -> int:
    """Number of processes with a core each, and memory."""
    memory = os.sysconf('SC_AVPHYS_PAGES') * os.sysconf('SC_PAGE_SIZE') // _GIGABYTE
    return max(1, min(os.cpu_count() or 1, memory // _NEEDED))


def _kinds(presets: Sequence[str]) -> dict[str, tuple[GuidanceSettings, ...]]:
    """Presets (all by default), grouped by the code that they need."""
    found: dict[str, tuple[GuidanceSettings, ...]] = {}
    for preset in presets or preset_names():
        for robot in robots_in(preset) or (None,):
            values = TABLE.resolve(load_parameter_file(preset, namespace=robot))
            settings = guidance_settings(values)
            around = settings.moving_obstacles
            moving = ' with moving obstacles' if around.capacity or around.others else ''
            name = f'road {values["road.type"]}{moving}'
            found[name] = (*found.get(name, ()), settings)
    return found


def _do(name: str, task: Callable[[], None]) -> Part:
    began = time.perf_counter()
    with compilations() as compiled:
        task()
    return Part(name, len(compiled), time.perf_counter() - began)


def _solver() -> None:
    """Compile the QP solver of the guidance law; horizon and rows do not matter."""
    sizes = 1, 3, 2, 2, 2
    program, active = empty_program(*sizes), empty_active_set(*sizes)
    entry_for(solve_program, program, active, empty_warm_start(*sizes))
    entry_for(correct, program, active, np.zeros(2), np.zeros((2, 2)))


def _drive(presets: Sequence[GuidanceSettings]) -> None:
    for each in presets:
        prepare(each)
        _measure(each)


def _measure(settings: GuidanceSettings) -> None:
    """Find the clearance of a path driven, as is done of every run and of every bag."""
    pose = settings.road.middle()
    settings.world.clearance(
        settings, pose[None], np.zeros((1, 2)), np.array([settings.control_period])
    )


def _scans() -> None:
    """Cast a ray, take it into a grid, and let somebody walk."""
    cast(np.zeros(1), np.zeros((1, 3)), np.zeros(1), np.zeros((0, 4)), np.zeros((0, 5)))
    people = People(PeopleSettings((Walker('one', (0.0, 0.0)),)), *map(np.zeros, ((0, 4), (0, 5))))
    people.begin(0)
    people.advance(1, np.zeros((1, 2)), 0.1)
    ends = np.zeros((1, 2))
    grid = LocalGrid(1.0, 0.1, 1.0)
    grid.see(Beams(0, ends[0], ends, ends, np.ones(1, dtype=bool), is_sweep=True))
    _ = GridObstacle('seen', grid.at(0)).islands
    small_groups(np.zeros((3, 3), dtype=bool), 1, 1)


def _method() -> None:
    problem = from_functions(
        horizon=3,
        x0=[1.0],
        controls=1,
        F=lambda _k, x, u: x + u,
        L=lambda _k, _x, u: u @ u,
        h=lambda x, _u: x,
        target=[0.0],
        g=lambda _k, x, _u: x - 2.0,
    )
    for qp in sorted({RICCATI_ACTIVE_SET, CLARABEL, 'daqp', 'hildreth'}.intersection(available())):
        options = Options(penalty_terminal=np.array([100.0]), penalty_path=np.array([100.0]), qp=qp)
        solve(problem, np.zeros((4, 1)), options, max_iterations=2)


# Sizes of the guidance law, on a long horizon.
_SIZES: Final = (400, 3, 2, 2, 4)
_RUNS: Final = 21


def work_rate() -> float:
    """Visits of a stage in a second [1/s], to two digits: the parameter `solver.work_rate`.

    The median of some solutions, from scratch, of one program with many active bounds.
    """
    p, active, warm = empty_program(*_SIZES), empty_active_set(*_SIZES), empty_warm_start(*_SIZES)
    rng, stages = np.random.default_rng(1), p.stages
    stages['A'], stages['L_XX'], stages['L_UU'] = np.eye(3), np.eye(3), np.eye(2)
    stages['B'] = 0.1 * rng.standard_normal(stages['B'].shape)
    stages['L_X'] = rng.standard_normal(stages['L_X'].shape)
    stages['lower'], stages['upper'] = -0.5, 0.5
    p.path['value'] = -math.inf
    p.terminal['X'][:, :2] = np.eye(2)
    enter, rates = entry_for(solve_program, p, active, warm), []
    for _ in range(_RUNS):
        warm.clear()
        p.head['work'] = p.head['is_factorised'] = 0
        began = time.perf_counter()
        enter(p, active, warm)
        rates.append(int(p.head['work'][0]) / (time.perf_counter() - began))
    rate = float(np.median(rates))
    digits = 10.0 ** (math.floor(math.log10(rate)) - 1)
    return round(rate / digits) * digits
