"""Compiles, once and for all processes to come, whatever the nodes and commands run."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from cmpsp_ros.guidance.preparation import prepare
from cmpsp_ros.mpsp import Options, from_functions, solve
from cmpsp_ros.mpsp.compile_watch import compilations
from cmpsp_ros.mpsp.kernel_folder import kernel_folder, old_folders, wanted_place
from cmpsp_ros.mpsp.qp import RICCATI_ACTIVE_SET, RICCATI_INTERIOR_POINT
from cmpsp_ros.parameters.catalogue import TABLE
from cmpsp_ros.parameters.presets import load_parameter_file, preset_names
from cmpsp_ros.parameters.settings import guidance_settings


@dataclass(frozen=True)
class Part:
    """One part of the work.

    Attributes:
        name: What was run.
        kernels: How many kernels had to be compiled for it.
        seconds: Time it took [s].
    """

    name: str
    kernels: int
    seconds: float


@dataclass(frozen=True)
class Outcome:
    """What a warm-up came to.

    Attributes:
        folder: Where the machine code is; None when there is no place for it.
        parts: What was run, in this order.
        removed: Folders of other versions that are gone.
    """

    folder: Path | None
    parts: tuple[Part, ...]
    removed: tuple[Path, ...]

    @property
    def hindrance(self) -> str:
        """What is wrong with the folder, in a sentence; empty when nothing is."""
        wanted = wanted_place()
        if self.folder is not None and self.folder.parent == wanted:
            return ''
        instead = (
            'nothing would be kept'
            if self.folder is None
            else 'a restart of the machine may remove it'
        )
        return f'{wanted} is no folder that only you can write to: {instead} (NUMBA_CACHE_DIR).'


def warm_up_all(progress: Callable[[str], None] = lambda _: None) -> Outcome:
    """Run everything that is compiled, and remove what other versions have left.

    Nothing is run where there is no folder to keep its machine code in.

    Args:
        progress: Told the name of each part before it begins.

    Raises:
        ParameterError: The presets cannot be read.
    """
    if kernel_folder() is None:
        return Outcome(None, (), ())
    parts = []
    for name, run in WORK.items():
        progress(name)
        began = time.perf_counter()
        with compilations() as compiled:
            run()
        parts.append(Part(name, len(compiled), time.perf_counter() - began))
    removed = old_folders()
    for each in removed:
        shutil.rmtree(each, ignore_errors=True)
    return Outcome(kernel_folder(), tuple(parts), tuple(removed))


def _guidance() -> None:
    for preset in preset_names():
        prepare(guidance_settings(TABLE.resolve(load_parameter_file(preset))))


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
    for qp in (RICCATI_ACTIVE_SET, RICCATI_INTERIOR_POINT, 'daqp', 'hildreth'):
        options = Options(penalty_terminal=np.array([100.0]), penalty_path=np.array([100.0]), qp=qp)
        solve(problem, np.zeros((4, 1)), options, max_iterations=2)


WORK: Final[dict[str, Callable[[], None]]] = {'guidance': _guidance, 'method': _method}
"""What is run, by name: a kernel that none of these reaches is compiled when it is first used."""
