"""Bags of robots whose parameters are hidden: the simulator without ROS, under the excitation."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from bag_messages import ODOMETRY, SECOND, STAMPED, TWIST, header, make, odometry, raw, twist

from cmpsp_ros.bags.identify.excitation import DURATION, excitation
from cmpsp_ros.bags.writer import BagWriter
from cmpsp_ros.robots.differential_drive import DifferentialDrive
from cmpsp_ros.simulator.measurement import OdometryErrors
from cmpsp_ros.simulator.physics import Physics
from cmpsp_ros.simulator.plant import Plant, PlantSettings

RADIUS, HALF_TRACK = 0.035, 0.055
START = 1_000 * SECOND


@dataclass(frozen=True)
class Hidden:
    """What is to be found.

    Attributes:
        delay: From the reception of a command to its effect [s].
        lag: Time constant of the wheels [s].
        scales: Speed and turn rate that are driven, as parts of those commanded.
        noise: Standard deviations of position and heading [m, rad].
        rate: Of odometry [Hz].
        age: Of odometry when it is received [s].
        jitter: Longest time that an odometry message takes in addition [s].
        clock: By how much the robot's clock is ahead of that of the bag [s].
        physics: Whether MuJoCo moves it.
        max_speed: Of a wheel on the floor [m/s].
        limits: Of the excitation [m/s, rad/s].
        command_rate: Commands a second [Hz].
        stamped: Whether commands are TwistStamped.
        seed: Of what is random.
    """

    delay: float = 0.1
    lag: float = 0.1
    scales: tuple[float, float] = (1.0, 1.0)
    noise: tuple[float, float] = (0.002, 0.002)
    rate: float = 30.0
    age: float = 0.01
    jitter: float = 0.004
    clock: float = 0.0
    physics: bool = False
    max_speed: float = 1.8
    limits: tuple[float, float] = (0.3, 1.5)
    command_rate: float = 20.0
    stamped: bool = False
    seed: int = 0


def drawn(seed: int) -> Hidden:
    """A random robot; every fifth has mass, motors and tyres."""
    random = np.random.default_rng(seed)
    return Hidden(
        delay=random.uniform(0.0, 0.3),
        lag=random.uniform(0.0, 0.3),
        scales=tuple(random.uniform(0.8, 1.2, 2)),
        noise=tuple(random.uniform(0.0, 0.005, 2)),
        rate=random.uniform(20.0, 50.0),
        age=random.uniform(0.0, 0.05),
        clock=random.uniform(-0.1, 0.1),
        physics=seed % 5 == 4,
        stamped=bool(random.integers(2)),
        seed=seed,
    )


def commands_of(hidden: Hidden) -> list[tuple[int, float, float]]:
    """When each command is received [ns], its speed and its turn rate."""
    ends, twists = excitation(*hidden.limits)
    times = np.arange(0.0, DURATION, 1.0 / hidden.command_rate)
    phases = np.minimum(np.searchsorted(ends, times, side='right'), len(ends) - 1)
    stamps = START + SECOND + np.round(times * SECOND).astype(np.int64)
    return [(int(at), *each) for at, each in zip(stamps, twists[phases].tolist(), strict=True)]


def write_bag(path, hidden: Hidden, commands=None, names=('/odom', '/cmd_vel')):
    """Drive, and write what a recorder on the computer would have received."""
    commands = commands_of(hidden) if commands is None else commands
    robot = DifferentialDrive(
        wheel_radius=RADIUS, half_track=HALF_TRACK, max_wheel_speed=hidden.max_speed / RADIUS
    )
    settings = PlantSettings(
        robot,
        odom_rate=hidden.rate,
        actuation_delay=hidden.delay,
        wheel_lag=hidden.lag,
        odometry=OdometryErrors(*hidden.noise),
        seed=hidden.seed,
        physics=Physics() if hidden.physics else None,
    )
    plant, random = Plant(settings, START), np.random.default_rng(hidden.seed)
    ahead = round(hidden.clock * SECOND)
    period = round(SECOND / hidden.rate)
    waiting, written = list(commands), []
    for stamp in range(START, commands[-1][0] + 2 * SECOND, period):
        while waiting and waiting[0][0] <= stamp:
            received, speed, turn = waiting.pop(0)
            plant.advance(received)
            plant.command(received, hidden.scales[0] * speed, hidden.scales[1] * turn)
            message = twist(speed, turn)
            if hidden.stamped:
                message = make(STAMPED, header(received, 'base_link'), message)
            written.append((received, names[1], raw(message)))
        plant.advance(stamp)
        pose = plant.measure()
        came = stamp + round((hidden.age + hidden.jitter * random.random()) * SECOND)
        written.append((came, names[0], raw(odometry(stamp + ahead, pose, plant.twist))))
    with BagWriter(path) as bag:
        bag.topic(names[0], ODOMETRY)
        bag.topic(names[1], STAMPED if hidden.stamped else TWIST)
        for stamp, name, message in sorted(written, key=lambda each: each[0]):
            bag.write(name, stamp, message)
    return path


__all__ = ['Hidden', 'commands_of', 'drawn', 'replace', 'write_bag']
