"""Real-time guidance of a differential-drive robot by C-MPSP, for ROS 2."""
