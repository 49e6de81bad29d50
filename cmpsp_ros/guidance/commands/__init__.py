"""What becomes of a plan: commands, slower ones, stops."""
