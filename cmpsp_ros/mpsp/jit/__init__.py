"""Compiled kernels and where they are kept; the one place that knows numba."""
