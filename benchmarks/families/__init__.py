"""What is timed: tasks that grow, tails, many plans, many obstacles."""
