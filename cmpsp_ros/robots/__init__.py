"""Models of robots: kinematics, Jacobians, limits."""
