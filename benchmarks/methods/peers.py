"""Solvers of CasADi, if it is installed."""

from importlib.util import find_spec
from typing import Any, Final

from benchmarks.methods.ours import Method
from benchmarks.task import Task

_QUIET_QRQP: Final = {'print_iter': False, 'print_header': False, 'print_info': False}

# Plug-in, its options, and the longest horizon that it is asked for. With its states kept a program
# has a singular Hessian, which daqp solves by proximal steps only.
_PLUGINS: Final[tuple[tuple[str, dict[str, Any], int], ...]] = (
    ('hpipm', {}, 400),
    ('piqp', {}, 400),
    ('daqp', {'daqp': {'eps_prox': 1e-3}}, 100),
    ('qrqp', _QUIET_QRQP, 50),
)

# IPOPT starts near the bounds where it ended before, and trusts the multipliers.
_PUSH: Final = 1e-6
_IPOPT: Final = {
    'print_level': 0,
    'sb': 'yes',
    'warm_start_init_point': 'yes',
    'mu_init': 1e-5,
    'warm_start_bound_push': _PUSH,
    'warm_start_bound_frac': _PUSH,
    'warm_start_slack_bound_push': _PUSH,
    'warm_start_slack_bound_frac': _PUSH,
    'warm_start_mult_bound_push': _PUSH,
}
_FATROP: Final = {'print_level': 0, 'mu_init': 1e-3}


def peers(task: Task) -> tuple[list[Method], dict[str, str]]:
    """All that can be compared with here.

    Returns:
        The methods, and why the others are missing, by name.
    """
    if find_spec('casadi') is None:
        return [], {'casadi': 'not installed, so not tried here'}
    import casadi  # noqa: PLC0415 (only if it is installed)

    from benchmarks.methods.casadi_methods import Converged, Sqp  # noqa: PLC0415

    found: list[Method] = []
    missing: dict[str, str] = {}
    for plugin, options, largest in _PLUGINS:
        if casadi.has_conic(plugin):
            found.append(Sqp(task, plugin, options, largest))
        else:
            missing[f'sqpmethod + {plugin}'] = 'not part of this CasADi'
    for solver, settings, keeps_multipliers in (
        ('fatrop', _FATROP, False),
        ('ipopt', _IPOPT, True),
    ):
        if casadi.has_nlpsol(solver):
            found.append(Converged(task, solver, settings, keeps_multipliers=keeps_multipliers))
        else:
            missing[solver] = 'not part of this CasADi'
    return found, missing
