"""What the user may set: one table of parameters, and what is built from it."""
