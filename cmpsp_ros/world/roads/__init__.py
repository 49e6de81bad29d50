"""Roads: what the robot stays inside, and whose centre line it keeps to."""
