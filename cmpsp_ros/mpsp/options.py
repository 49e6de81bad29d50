"""How the iteration is run."""

from __future__ import annotations

from dataclasses import dataclass

from cmpsp_ros.mpsp.errors import ProblemError
from cmpsp_ros.mpsp.problem import Array, Dimensions, Hessian
from cmpsp_ros.mpsp.qp import RICCATI_ACTIVE_SET, backend


@dataclass(frozen=True)
class Options:
    """How the iteration is run.

    Where constraints contradict each other those with the least penalty are relaxed first and
    alone, and only where that is not enough all of them are.

    Attributes:
        penalty_terminal: Weight of each terminal output in merit and relaxation, shape ``(m,)``.
        penalty_path: Weight of each path constraint in merit and relaxation, shape ``(l,)``.
        qp: Name of the QP back end; not asked where the closed form (35) will do.
        hessian: Which Hessian of the cost.
        elastic: Whether a subproblem without a feasible point is solved relaxed.
        trust_radius: Largest predicted change of each state component in one iteration, shape
            ``(n,)``, infinite where free; None for no trust region.
        line_search: Whether a step is shortened until it lowers the merit; the paper's iteration
            (43) takes the full step.
        output_tolerance: ``eps_Y`` of Sec. 4.
        control_tolerance: ``eps_U`` of Sec. 4.
        violation_tolerance: Largest path constraint (4) at a solution, absolute. Sec. 4 does not
            ask for it, but without it a point outside the constraints could pass for one.
        growth_limit: Growth of the controls or the cost since the guess, as a factor, from which
            on a run has diverged.
    """

    penalty_terminal: Array
    penalty_path: Array
    qp: str = RICCATI_ACTIVE_SET
    hessian: Hessian = 'gauss_newton'
    elastic: bool = True
    trust_radius: Array | None = None
    line_search: bool = True
    output_tolerance: float = 1e-9
    control_tolerance: float = 1e-6
    violation_tolerance: float = 1e-6
    growth_limit: float = 1e10

    def check(self, size: Dimensions) -> None:
        """Raise unless the options fit a problem's dimensions.

        Raises:
            ProblemError: Names the option, the shape found and the one wanted, or says which QP
                back ends are installed.
        """
        wanted = {'penalty_terminal': size.output, 'penalty_path': size.path}
        if self.trust_radius is not None:
            wanted['trust_radius'] = size.state
        for name, length in wanted.items():
            found = getattr(self, name).shape
            if found != (length,):
                raise ProblemError(f'{name}: found shape {found}, wanted {(length,)}')
        backend(self.qp)
