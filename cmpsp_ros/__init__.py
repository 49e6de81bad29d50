"""Real-time guidance of wheeled robots by C-MPSP, for ROS 2."""
