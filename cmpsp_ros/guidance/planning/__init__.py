"""From a pose to the best plan: guesses, iterations, and the choice among candidates."""
