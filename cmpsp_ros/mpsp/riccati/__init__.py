"""Compiled solvers that work along the stages of a subproblem instead of condensing it."""
