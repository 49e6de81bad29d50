"""Options of the iteration."""

from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from cmpsp_ros.arrays import Array
from cmpsp_ros.mpsp.arguments import ProblemError, numbers
from cmpsp_ros.mpsp.problem import Dimensions, Hessian
from cmpsp_ros.mpsp.qp import RICCATI_ACTIVE_SET, backend

_TOLERANCES: Final = (
    'output_tolerance',
    'control_tolerance',
    'violation_tolerance',
    'kkt_tolerance',
    'growth_limit',
)


Method = Literal['auto', 'cmpsp', 'multiple_shooting']
_PENALTY: Final = 1e3


@dataclass(frozen=True)
class Options:
    """Options of the iteration.

    Where constraints contradict each other those with the least penalty are relaxed first and
    alone, and only where that is not enough all of them are.

    Attributes:
        penalty_terminal: Weight of each terminal output in merit and relaxation, one for all or
            shape ``(m,)``; not negative. None for 1000 in scaled units.
        penalty_path: Weight of each path constraint in merit and relaxation, one for all or shape
            ``(l,)``; not negative, infinite for a linear one that is never relaxed and that the
            guess meets. None for 1000 in scaled units.
        qp: Name of the QP back end. Others than the default one are not asked where the closed
            form (35) will do.
        hessian: Which Hessian of the cost.
        elastic: Whether a subproblem without a feasible point is solved relaxed.
        trust_radius: Largest predicted change of each state component in one iteration, one for
            all or shape ``(n,)``, infinite where free; None for no trust region.
        line_search: Whether a step is shortened until it lowers the merit; the paper's iteration
            (43) takes the full step.
        output_tolerance: ``eps_Y`` of Sec. 4.
        control_tolerance: ``eps_U`` of Sec. 4.
        violation_tolerance: Largest path constraint (4) at a solution, absolute. Sec. 4 does not
            ask for it, but without it a point outside the constraints could pass for one.
        kkt_tolerance: Largest violation of the optimality conditions at a solution, relative to 1
            plus the largest part of the gradient.
        growth_limit: Growth of the controls or the cost since the guess, as a factor, from which
            on a run has diverged.
        method: How `solve` goes about it: ``cmpsp``, the paper's iteration; ``multiple_shooting``
            with exact second derivatives; ``auto`` begins with the former and goes on with the
            latter where it has not converged after 15 iterations, gets on slowly, or ends in
            another way.
        scaling: Whether `solve` scales the problem; tolerances are then relative to its units.
    """

    penalty_terminal: ArrayLike | None = None
    penalty_path: ArrayLike | None = None
    qp: str = RICCATI_ACTIVE_SET
    hessian: Hessian = 'gauss_newton'
    elastic: bool = True
    trust_radius: ArrayLike | None = None
    line_search: bool = True
    output_tolerance: float = 1e-9
    control_tolerance: float = 1e-6
    violation_tolerance: float = 1e-6
    kkt_tolerance: float = 1e-6
    growth_limit: float = 1e10
    method: Method = 'auto'
    scaling: bool = True

    def fitted(self, size: Dimensions) -> tuple[Array, Array, Array]:
        """Penalties of outputs ``(m,)`` and paths ``(l,)``, and the trust region's radius ``(n,)``.

        Raises:
            ProblemError: Names the option, or says which QP back ends are installed.
        """
        backend(self.qp)
        if self.method not in get_args(Method):
            wanted = ', '.join(get_args(Method))
            raise ProblemError(f'method: found {self.method!r}, wanted one of {wanted}')
        for name in _TOLERANCES:
            value = getattr(self, name)
            if not value >= 0.0:
                raise ProblemError(f'{name}: found {value}, wanted a number >= 0')
        return (
            _not_negative('penalty_terminal', self.penalty_terminal, size.output, _PENALTY),
            _not_negative('penalty_path', self.penalty_path, size.path, _PENALTY),
            _not_negative('trust_radius', self.trust_radius, size.state, np.inf),
        )


def _not_negative(name: str, value: ArrayLike | None, length: int, otherwise: float) -> Array:
    if value is None:
        return np.full(length, otherwise)
    array = numbers(name, value)
    if array.shape not in {(), (length,)}:
        raise ProblemError(f'{name}: found shape {array.shape}, wanted {(length,)}')
    if not (array >= 0.0).all():
        raise ProblemError(f'{name}: found {value!r}, wanted numbers >= 0')
    return np.broadcast_to(array, (length,)).copy()
