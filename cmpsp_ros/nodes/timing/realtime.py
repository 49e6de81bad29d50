"""Scheduling of the control thread: a real-time priority and its own core."""

from __future__ import annotations

import os
import resource
from typing import TYPE_CHECKING

from cmpsp_ros.parameters import ParameterError, Problem

if TYPE_CHECKING:
    from cmpsp_ros.parameters import Values

ANY_CPU = -1


def check_cpu(values: Values) -> None:
    """Refuse a core that this process may not run on.

    Args:
        values: A set resolved by the table.

    Raises:
        ParameterError: `realtime.cpu` names no such core.
    """
    cpu, allowed = values['realtime.cpu'], sorted(os.sched_getaffinity(0))
    if cpu != ANY_CPU and cpu not in allowed:
        wanted = f'{ANY_CPU} for any, or one of {", ".join(map(str, allowed))}'
        raise ParameterError(Problem('realtime.cpu', str(cpu), wanted))


class Scheduling:
    """Scheduling of the calling thread, as set by the parameters or as before."""

    def __init__(self, values: Values) -> None:
        """Take the wishes from a set of parameters."""
        self._priority: int = values['realtime.priority']
        self._cpu: int = values['realtime.cpu']
        self._policy_before: tuple[int, os.sched_param] | None = None
        self._cpus_before: set[int] | None = None

    def apply(self) -> list[str]:
        """Schedule the calling thread as configured.

        Returns:
            Sentences on what the system has refused; the thread continues without it.
        """
        refused = []
        if self._cpu != ANY_CPU:
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
