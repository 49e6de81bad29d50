"""How a solver ended, as numbers that compiled code can return."""

SOLVED = 0
"""The point meets the optimality conditions."""

INFEASIBLE = 1
"""No point meets all rows that are hard."""

ITERATION_LIMIT = 2
"""Iterations or numerical accuracy ran out before the conditions were met."""

NO_CURVATURE = 3
"""The Hessian in the controls is not positive definite."""
