"""The stage-wise quadratic program and its solver: Riccati sweeps and a dual active set."""
