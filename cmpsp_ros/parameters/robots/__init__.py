"""Parameters of the robot: its model and limits, its footprint, and its sensors."""
