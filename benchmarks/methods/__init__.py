"""Ways of solving the same task, ours and others'."""
