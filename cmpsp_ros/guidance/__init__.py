"""The guidance law: from odometry to commands as a pure state machine, without ROS."""
