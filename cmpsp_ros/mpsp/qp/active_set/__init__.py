"""The active-set method on stage-wise programs."""
