"""A robot with mass, motors and tyres, driven by MuJoCo.

Nothing that the guidance knows of the robot is used here but wheel radius and track: whether its
wheels reach a speed, and whether they slip on the way, follows from torque, mass and friction.
"""

import math
from importlib import import_module
from typing import Any, Final

import numpy as np

from cmpsp_ros.arrays import Array
from cmpsp_ros.robots import Robot
from cmpsp_ros.robots.motion import arc_ends
from cmpsp_ros.simulator.body import Motion
from cmpsp_ros.simulator.settings import Physics

_NS: Final = 1_000_000_000

TIMESTEP_NS: Final = 1_000_000  # step of the integration [ns]
_STIFFNESS: Final = 0.05  # torque for each rad/s that a wheel is too slow, at 1 kg [N m s/rad]
_EVERY: Final = 5  # steps from one motion that is told to the next


class PhysicsError(ValueError):
    """MuJoCo is asked for and cannot be used; the message says why."""


def mjcf(robot: Robot, physics: Physics, wheel_lag: float) -> str:
    """The robot on an endless floor, in MuJoCo's own format (MJCF).

    Two driven wheels that touch the floor in one point each, and two castors without friction
    before and behind them. The motors hold their wheels at a commanded speed as far as their
    torque goes; with a lag [s], the command reaches them through a filter of first order.
    """
    radius, track = robot.wheel_radius, robot.half_track
    castor, arm = 0.4 * radius, 0.9 * track
    wheel_mass, gain = 0.05 * physics.mass, _STIFFNESS * physics.mass
    body_mass = physics.mass - 2.0 * wheel_mass
    dynamics = f'dyntype="filterexact" dynprm="{wheel_lag!r}"' if wheel_lag > 0.0 else ''
    wheels = ''.join(
        f"""
      <body name="{side}" pos="0 {y!r} 0">
        <joint name="{side}" type="hinge" axis="0 1 0" damping="0"/>
        <geom type="sphere" size="{radius!r}" mass="{wheel_mass!r}" condim="4" group="3"
              friction="{physics.friction!r} 0.0005 0.0001"/>
        <geom type="cylinder" size="{radius!r} {0.2 * radius!r}" euler="90 0 0" mass="0"
              contype="0" conaffinity="0" rgba="0.15 0.15 0.15 1"/>
        <geom type="box" size="{0.75 * radius!r} {0.21 * radius!r} {0.12 * radius!r}" mass="0"
              contype="0" conaffinity="0" rgba="0.8 0.8 0.8 1"/>
      </body>"""
        for side, y in (('right', -track), ('left', track))
    )
    castors = ''.join(
        f"""
      <geom type="sphere" size="{castor!r}" pos="{x!r} 0 {castor - radius!r}" mass="0" condim="1"
            rgba="0.5 0.5 0.5 1"/>"""
        for x in (-arm, arm)
    )
    motors = ''.join(
        f"""
    <general joint="{side}" biastype="affine" gainprm="{gain!r}" biasprm="0 0 {-gain!r}"
             forcerange="{-physics.torque!r} {physics.torque!r}" {dynamics}/>"""
        for side in ('right', 'left')
    )
    return f"""<mujoco model="differential drive">
  <option timestep="{TIMESTEP_NS / 1e9!r}" integrator="implicitfast" cone="elliptic"
          impratio="10"/>
  <default><geom solref="0.004 1"/></default>
  <worldbody>
    <geom type="plane" size="0 0 1" rgba="0.9 0.9 0.9 1" condim="1" friction="0 0 0"/>
    <body name="robot" pos="0 0 {radius!r}">
      <freejoint/>
      <geom type="box" size="{1.1 * track!r} {0.75 * track!r} {0.4 * radius!r}"
            pos="0 0 {0.2 * radius!r}" mass="{body_mass!r}" contype="0" conaffinity="0"
            rgba="0.12 0.35 0.65 1"/>{castors}{wheels}
    </body>
  </worldbody>
  <actuator>{motors}
  </actuator>
</mujoco>
"""


class PhysicsBody:
    """Steps of 1 ms; between two of them the robot drives an arc at the twist of the last.

    A command takes effect with the next step. The same commands give the same path to the last
    bit, with the same version of MuJoCo on the same kind of processor.
    """

    def __init__(self, robot: Robot, wheel_lag: float, physics: Physics) -> None:
        """A robot that has not been placed yet; the lag of its motors is 0 for none [s]."""
        try:
            # An option, which takes a while to import.
            self._mujoco: Any = import_module('mujoco')
        except ImportError as error:
            found = "found 'mujoco', which is not installed (pip install mujoco)"
            raise PhysicsError(f'plant: {found}: {error}') from None
        self._physics = physics
        self._build(robot, wheel_lag)

    def place(self, stamp_ns: int, pose: Array) -> None:
        """Put the robot at a pose, at rest."""
        self._mujoco.mj_resetData(self._model, self._data)
        x, y, heading = pose.tolist()
        turn = (math.cos(heading / 2.0), 0.0, 0.0, math.sin(heading / 2.0))
        self._data.qpos[:7] = (x, y, self._robot.wheel_radius, *turn)
        self._mujoco.mj_forward(self._model, self._data)
        self._from_ns, self._steps = stamp_ns, 0
        self._heading = heading
        self._by_encoders = pose.copy()

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
        self._mujoco.mj_forward(self._model, self._data)

    def follow(self, _stamp_ns: int, wheel_speeds: Array, _grip: Array) -> None:
        """Command the motors; how the tyres grip is a matter of friction."""
        self._data.ctrl[:] = wheel_speeds

    def drive(self, stamp_ns: int) -> list[Motion]:
        """Step up to an instant."""
        told = []
        while self._reached_ns + TIMESTEP_NS <= stamp_ns:
            before = self._angles()
            self._mujoco.mj_step(self._model, self._data)
            self._steps += 1
            w, x, y, z = self._data.qpos[3:7].tolist()
            heading = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
            self._heading += math.remainder(heading - self._heading, math.tau)
            # Dead reckoning by the turns of the wheels in this step [rad].
            turned = (self._angles() - before)[None]
            self._by_encoders = self._robot.roll_out(self._by_encoders, turned, np.ones(1))[1]
            if self._steps % _EVERY == 0:
                told.append(self.motion(self._reached_ns))
        return told

    def motion(self, stamp_ns: int) -> Motion:
        """Pose and speeds, the pose carried on along an arc since the last step."""
        x, y = self._data.qpos[:2].tolist()
        vx, vy, _, _, _, yaw_rate = self._data.qvel[:6].tolist()
        # Without sideways slip.
        ahead = vx * math.cos(self._heading) + vy * math.sin(self._heading)
        pose, twist = np.array([x, y, self._heading]), np.array([ahead, yaw_rate])
        since = (stamp_ns - self._reached_ns) / _NS
        if since > 0.0:
            pose = arc_ends(pose[None], twist[None], np.array([since]))[0]
        return Motion(stamp_ns, pose, self._data.qvel[6:8].copy(), twist)

    def odometry(self, stamp_ns: int) -> Array:
        """Dead reckoning by the encoders, or the true pose."""
        return (
            self._by_encoders.copy()
            if self._physics.odometry == 'encoders'
            else self.motion(stamp_ns).pose
        )

    @property
    def _reached_ns(self) -> int:
        return self._from_ns + self._steps * TIMESTEP_NS

    def _build(self, robot: Robot, wheel_lag: float) -> None:
        self._robot = robot
        try:
            self._model = self._mujoco.MjModel.from_xml_string(
                mjcf(robot, self._physics, wheel_lag)
            )
        except ValueError as error:
            raise PhysicsError(f'MuJoCo refuses the robot: {error}') from None
        self._data = self._mujoco.MjData(self._model)

    def _angles(self) -> Array:
        return np.asarray(self._data.qpos[7:9].copy())
