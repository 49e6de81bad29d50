"""Whether a run could have done better: other solvers, and searches."""
