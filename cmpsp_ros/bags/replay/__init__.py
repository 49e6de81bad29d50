"""Replay: recorded odometry through the guidance law again, as it was or changed."""
