"""From the selected plan to the decision: commands, slower ones, stops."""
