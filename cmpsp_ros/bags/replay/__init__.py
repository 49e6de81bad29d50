"""Replay: recorded odometry through the guidance law again, unchanged or changed."""
