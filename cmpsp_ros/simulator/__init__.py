"""A stand-in for the robot, without ROS: plant, wheel lag, slip, physics, measurement."""
