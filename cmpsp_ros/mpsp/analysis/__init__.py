"""What can be said of a run and its solution: convergence, and the conditions of Theorem 2."""
