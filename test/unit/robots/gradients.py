"""Derivatives of a path by its poses and controls, as the compiled problem takes them."""

import numpy as np

from cmpsp_ros.robots.motion import put_gradients


def jacobians(robot, poses, controls, durations):
    """Derivatives ``A (N, 3, 3)`` and ``B (N, 3, r)`` of all steps by pose and control."""
    A = np.zeros((len(durations), 3, 3))
    B = np.zeros((len(durations), 3, robot.n_controls))
    for k, duration in enumerate(durations):
        put_gradients(A[k], B[k], poses[k, 2], controls, k, duration, robot.kinematics)
    return A, B
