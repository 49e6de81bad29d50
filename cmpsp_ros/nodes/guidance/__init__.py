"""The guidance node: odometry in, velocity commands out."""
