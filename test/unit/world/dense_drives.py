"""Drives integrated densely, without any formula of ours."""

import numpy as np

PIECES = 400


def integrated(pose, wheels, period, robot):
    """Places along a drive, by the midpoint rule on ``x' = v cos, y' = v sin`` in fine pieces."""
    right, left = np.repeat(wheels, PIECES, axis=0).T * robot.wheel_radius
    speed, turn_rate = (right + left) / 2.0, (right - left) / (2.0 * robot.half_track)
    step = period / PIECES
    after = pose[2] + np.cumsum(turn_rate) * step
    middle = after - turn_rate * step / 2.0
    x = pose[0] + np.concatenate([[0.0], np.cumsum(speed * np.cos(middle)) * step])
    y = pose[1] + np.concatenate([[0.0], np.cumsum(speed * np.sin(middle)) * step])
    return np.column_stack([x, y])


def error_of(wheels, period, robot):
    """More than the midpoint rule can err over the whole drive [m]."""
    speed = np.abs(wheels).max() * robot.wheel_radius
    turn_rate = np.abs(wheels[:, 0] - wheels[:, 1]).max() * robot.wheel_radius
    turn_rate /= 2.0 * robot.half_track
    turned = turn_rate * period / PIECES
    return 1e-9 + speed * period * len(wheels) * turned**2 / 24.0
