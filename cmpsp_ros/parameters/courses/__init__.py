"""What a course is, from its parameters: road, obstacles, goals, and what is wrong with them."""
