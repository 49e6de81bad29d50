"""Keeping control steps on time: compilation, garbage collection, scheduling."""

import gc
import math
import os
import resource
import time
from collections.abc import Callable
from contextlib import ExitStack

from rclpy.impl.rcutils_logger import RcutilsLogger

from cmpsp_ros.mpsp.jit import compilations, progress
from cmpsp_ros.parameters import ParameterError, Problem, Values

_ANY_CPU = -1
_YOUNG, _FULL = 1, 2
_FULL_EVERY = 50
_SHARE_OF_SLACK = 0.25
_OVERDUE = 1.0


def prepare_aloud(prepare: Callable[[], None], logger: RcutilsLogger) -> None:
    """Compile or load everything now, and log it."""
    began, hints = time.monotonic(), ['compiling, once; `cmpsp warmup` does it beforehand']

    def say(text: str) -> None:
        while hints:
            logger.info(hints.pop())
        logger.info(text)

    with progress(say=say) as kernels:
        prepare()
    if kernels:
        logger.info(f'compiled {len(kernels)} kernels in {time.monotonic() - began:.1f} s')


class LateCompilations:
    """Detects kernels that are compiled while a node is active: each delays a control step."""

    def __init__(self) -> None:
        self._names: list[str] = []
        self._watch = ExitStack()

    def begin(self) -> None:
        """Notice them from now on."""
        self.end()
        self._names = self._watch.enter_context(compilations())

    def end(self) -> None:
        """Stop the detection; `errors` is kept."""
        self._watch.close()

    def errors(self) -> list[str]:
        """Sentence on compiled kernels, if any."""
        if not self._names:
            return []
        return [f'A control step had to wait for a compiler: {", ".join(self._names)}.']


class GarbageCollection:
    """Collects garbage on request; objects that exist at its start are not examined again."""

    def __init__(self) -> None:
        self._on = False

    @property
    def overdue(self) -> bool:
        """True if idle time has been lacking for so long that collection is due now."""
        return self._on and time.monotonic() - self._latest > _OVERDUE

    def settle(self) -> None:
        """Collect and freeze the whole heap: a tenth of a second, outside of control steps."""
        gc.collect()
        gc.freeze()

    def begin(self) -> None:
        """Disable automatic collection."""
        self._took = {_YOUNG: 0.0, _FULL: 0.0}
        self._since_full = 0
        self.settle()
        gc.disable()
        self._latest = time.monotonic()
        self._on = True

    def end(self) -> None:
        """Enable automatic collection again."""
        gc.unfreeze()
        if self._on:
            self._on = False
            gc.enable()

    def collect(self, slack: float = math.inf) -> None:
        """Collect, if that takes a small part of the time until the next control step [s]."""
        if not self._on:
            return
        fits = [each for each, took in self._took.items() if took <= _SHARE_OF_SLACK * slack]
        full_due = self._since_full >= _FULL_EVERY
        if _FULL in fits and full_due:
            self._collect(_FULL)
            self._since_full = 0
        elif _YOUNG in fits:
            self._collect(_YOUNG)
            self._since_full += 1

    def _collect(self, generation: int) -> None:
        begun = time.monotonic()
        gc.collect(generation)
        self._latest = time.monotonic()
        self._took[generation] = self._latest - begun


def check_cpu(values: Values) -> None:
    """Refuse a core that this process may not run on with a ParameterError."""
    cpu, allowed = values['realtime.cpu'], sorted(os.sched_getaffinity(0))
    if cpu != _ANY_CPU and cpu not in allowed:
        wanted = f'{_ANY_CPU} for any, or one of {", ".join(map(str, allowed))}'
        raise ParameterError(Problem('realtime.cpu', str(cpu), wanted))


class Scheduling:
    """Scheduling of the calling thread, as set by the parameters or as before."""

    def __init__(self, values: Values) -> None:
        self._priority: int = values['realtime.priority']
        self._cpu: int = values['realtime.cpu']
        self._policy_before: tuple[int, os.sched_param] | None = None
        self._cpus_before: set[int] | None = None

    def apply(self) -> list[str]:
        """Schedule the calling thread as configured; sentences on refusals of the system."""
        refused = []
        if self._cpu != _ANY_CPU:
            before = os.sched_getaffinity(0)
            try:
                os.sched_setaffinity(0, {self._cpu})
                self._cpus_before = before
            except OSError as error:
                refused.append(f'realtime.cpu = {self._cpu} was refused ({error.strerror}).')
        if self._priority:
            policy = os.sched_getscheduler(0), os.sched_getparam(0)
            try:
                # Threads and processes started from here on do not inherit it.
                wanted = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
                os.sched_setscheduler(0, wanted, os.sched_param(self._priority))
                self._policy_before = policy
            except OSError as error:
                limit, _ = resource.getrlimit(resource.RLIMIT_RTPRIO)
                refused.append(
                    f'realtime.priority = {self._priority} was refused ({error.strerror}; the'
                    f' limit is {limit}). A line "USER - rtprio {self._priority}" in'
                    ' /etc/security/limits.conf and a new login permit it, or CAP_SYS_NICE.'
                )
        return refused

    def restore(self) -> None:
        """Restore the previous scheduling."""
        if self._policy_before is not None:
            policy, parameters = self._policy_before
            # Only with CAP_SYS_NICE may the flag be taken back; it changes nothing here.
            os.sched_setscheduler(0, policy | os.SCHED_RESET_ON_FORK, parameters)
            self._policy_before = None
        if self._cpus_before is not None:
            os.sched_setaffinity(0, self._cpus_before)
            self._cpus_before = None
