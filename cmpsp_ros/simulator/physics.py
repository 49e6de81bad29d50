"""A robot with mass, motors and tyres, as a model for MuJoCo."""

from __future__ import annotations

from typing import Final

from cmpsp_ros.robots import Robot
from cmpsp_ros.simulator.settings import Physics

TIMESTEP_NS: Final = 1_000_000
"""Step of the integration [ns]."""

_STIFFNESS: Final = 0.05
"""Torque of a motor for each rad/s that its wheel is too slow, at 1 kg [N m s/rad]."""


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
