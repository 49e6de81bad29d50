"""A robot with mass, motors and tyres, driven by MuJoCo.

Nothing that the guidance knows of the robot is used here but wheel radius and track: whether its
wheels reach a speed, and whether they slip on the way, follows from torque, mass and friction.
"""

from __future__ import annotations

import math

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.robots import Robot, arc_ends
from cmpsp_ros.simulator.body import Motion
from cmpsp_ros.simulator.physics import TIMESTEP_NS, Physics, PhysicsError, mjcf

try:
    import mujoco
except ImportError as error:
    raise PhysicsError(
        f"plant: found 'mujoco', which is not installed (pip install mujoco): {error}"
    ) from None


_NS = 1_000_000_000

_EVERY = 5
"""Steps from one motion that is told to the next."""


class PhysicsBody:
    """Steps of 1 ms; between two of them the robot drives an arc at the twist of the last.

    A command takes effect with the next step. The same commands give the same path to the last
    bit, with the same version of MuJoCo on the same kind of processor.
    """

    def __init__(self, robot: Robot, wheel_lag: float, physics: Physics) -> None:
        """A robot that has not been placed yet; the lag of its motors is 0 for none [s]."""
        self._physics = physics
        self._build(robot, wheel_lag)

    def place(self, stamp_ns: int, pose: Array) -> None:
        """Put the robot at a pose, at rest."""
        mujoco.mj_resetData(self._model, self._data)
        x, y, heading = pose.tolist()
        turn = (math.cos(heading / 2.0), 0.0, 0.0, math.sin(heading / 2.0))
        self._data.qpos[:7] = (x, y, self._robot.wheel_radius, *turn)
        mujoco.mj_forward(self._model, self._data)
        self._from_ns, self._steps = stamp_ns, 0
        self._heading = heading
        self._reckoned = pose.copy()

    def reconfigure(self, _stamp_ns: int, robot: Robot, wheel_lag: float) -> None:
        """Go on as another robot, from the same pose at the same speed."""
        old = self._data
        self._build(robot, wheel_lag)
        self._data.qpos[:], self._data.qvel[:] = old.qpos, old.qvel
        self._data.ctrl[:] = old.ctrl
        if self._model.na == len(old.act):
            self._data.act[:] = old.act
        elif self._model.na:
            self._data.act[:] = old.ctrl
        mujoco.mj_forward(self._model, self._data)

    def follow(self, _stamp_ns: int, wheel_speeds: Array, _grip: Array) -> None:
        """Command the motors; how the tyres grip is a matter of friction."""
        self._data.ctrl[:] = wheel_speeds

    def drive(self, stamp_ns: int) -> list[Motion]:
        """Step up to an instant."""
        told = []
        while self._reached_ns + TIMESTEP_NS <= stamp_ns:
            before = self._angles()
            mujoco.mj_step(self._model, self._data)
            self._steps += 1
            self._note_heading()
            self._reckon(self._angles() - before)
            if self._steps % _EVERY == 0:
                told.append(self.motion(self._reached_ns))
        return told

    def motion(self, stamp_ns: int) -> Motion:
        """Pose and speeds, the pose carried on along an arc since the last step."""
        x, y = self._data.qpos[:2].tolist()
        pose, twist = np.array([x, y, self._heading]), self._twist()
        since = (stamp_ns - self._reached_ns) / _NS
        if since > 0.0:
            pose = arc_ends(pose[None], twist[None], np.array([since]))[0]
        return Motion(stamp_ns, pose, self._data.qvel[6:8].copy(), twist)

    def odometry(self, stamp_ns: int) -> Array:
        """Dead reckoning by the encoders, or the true pose."""
        return (
            self._reckoned.copy()
            if self._physics.odometry == 'encoders'
            else self.motion(stamp_ns).pose
        )

    @property
    def _reached_ns(self) -> int:
        return self._from_ns + self._steps * TIMESTEP_NS

    def _build(self, robot: Robot, wheel_lag: float) -> None:
        self._robot = robot
        try:
            self._model = mujoco.MjModel.from_xml_string(mjcf(robot, self._physics, wheel_lag))
        except ValueError as error:
            raise PhysicsError(f'MuJoCo refuses the robot: {error}') from None
        self._data = mujoco.MjData(self._model)

    def _angles(self) -> Array:
        angles: Array = self._data.qpos[7:9].copy()
        return angles

    def _twist(self) -> Array:
        """Speed ahead and yaw rate, without sideways slip."""
        vx, vy = self._data.qvel[:2].tolist()
        ahead = vx * math.cos(self._heading) + vy * math.sin(self._heading)
        return np.array([ahead, float(self._data.qvel[5])])

    def _note_heading(self) -> None:
        w, x, y, z = self._data.qpos[3:7].tolist()
        heading = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        self._heading += math.remainder(heading - self._heading, math.tau)

    def _reckon(self, turned: Array) -> None:
        """Update dead reckoning by the turns of the wheels in one step [rad]."""
        self._reckoned = self._robot.roll_out(self._reckoned, turned[None], np.ones(1))[1]
