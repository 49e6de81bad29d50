"""Solvers of whole programs: dense ones of the condensed program, Clarabel, the closed form."""
