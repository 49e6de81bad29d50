"""The stage-wise quadratic program: its records, Riccati sweeps, and the check of an answer."""
