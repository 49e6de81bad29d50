"""What is special to the two-wheeled robot: kinematics, road, obstacles, its problem."""
