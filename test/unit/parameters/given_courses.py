"""Parameters of courses and robots other than the defaults."""

BEND = {
    'road.type': 'corridor', 'road.points': [0.0, 0.0, 3.0, 0.0, 6.0, 1.0, 8.0, 3.0],
    'goal.position': [6.0, 1.0], 'initial_pose': [0.5, 0.0, 0.0],
}  # fmt: skip
WAYPOINTS = {
    'waypoints.names': ['a', 'b'],
    'waypoints.a.position': [7.0, -7.0], 'waypoints.a.time': 4.0,
    'waypoints.b.position': [9.5, -3.0], 'waypoints.b.time': 8.0, 'waypoints.b.heading': [1.2],
}  # fmt: skip
MECANUM = {
    'robot.model': 'mecanum', 'robot.half_wheel_base': 0.08, 'initial_guess.type': 'road',
    'robot.joint_names': ['a', 'b', 'c', 'd'],
}  # fmt: skip
THREE = MECANUM | {
    'robot.model': 'omni_wheels', 'robot.joint_names': ['a', 'b', 'c'],
    'robot.wheel_bearings': [1.0, 3.1, 5.2],
}  # fmt: skip
CAR = {
    'robot.model': 'ackermann', 'robot.joint_names': ['rear'], 'robot.wheel_base': 2.5,
    'robot.max_steering_angle': 0.6, 'initial_guess.type': 'road',
}  # fmt: skip
SQUARE = [9.5, -3.0, 10.5, -3.0, 10.5, -2.0, 9.5, -2.0]
