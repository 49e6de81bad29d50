"""Bags of robots whose parameters are hidden: the simulator without ROS, under the excitation."""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np
from bag_messages import SECOND, STAMPED, header, make, odometry, twist, write_bag

from cmpsp_ros.bags.identify import excitation
from cmpsp_ros.robots import DifferentialDrive
from cmpsp_ros.simulator import OdometryErrors, Physics, Plant, PlantSettings, TwistError

RADIUS, HALF_TRACK = 0.035, 0.055
START = 1_000 * SECOND


@dataclass(frozen=True)
class Hidden:
    """Parameters to be found.

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
    times = np.arange(0.0, ends[-1], 1.0 / hidden.command_rate)
    phases = np.minimum(np.searchsorted(ends, times, side='right'), len(ends) - 1)
    stamps = START + SECOND + np.round(times * SECOND).astype(np.int64)
    return [(int(at), *each) for at, each in zip(stamps, twists[phases].tolist(), strict=True)]


def record(path, hidden: Hidden, commands=None, names=('/odom', '/cmd_vel'), **options):
    """Drive, and write what a recorder on the computer would have received.

    Args:
        path: New bag.
        hidden: The robot.
        commands: As from `commands_of`, and these by default.
        names: Topics of odometry and commands; commands without a name are not recorded.
        options: Of `_driven`, and `others`: more robots by namespace, the first one is in `/r1`.
    """
    others = options.pop('others', {})
    robots = {names: hidden}
    if others:
        spaces = {'/r1': hidden, **others}
        robots = {(f'{space}/odom', f'{space}/cmd_vel'): each for space, each in spaces.items()}
    written = []
    for topics, each in robots.items():
        driven = _driven(each, commands_of(each) if commands is None else commands, **options)
        named = ((topics[kind], stamp, message) for stamp, kind, message in driven)
        written += [each for each in named if each[0]]
    return write_bag(path, sorted(written, key=lambda each: each[1]))


def _driven(hidden: Hidden, commands, jump=None, *, moving=False, answering=False):
    """Messages with the times of their reception; 0 is odometry, 1 a command.

    Args:
        hidden: The robot.
        commands: What it receives.
        jump: By how much odometry jumps half way (x, y) [m].
        moving: Whether it follows the first command from the start on.
        answering: Whether stamps of commands are those of the last odometry before.
    """
    robot = DifferentialDrive(
        wheel_radius=RADIUS, half_track=HALF_TRACK, max_wheel_speed=hidden.max_speed / RADIUS
    )
    settings = PlantSettings(
        robot,
        (0.0, 0.0, 0.0),
        odom_rate=hidden.rate,
        actuation_delay=hidden.delay,
        wheel_lag=hidden.lag,
        odometry=OdometryErrors(*hidden.noise),
        seed=hidden.seed,
        physics=Physics() if hidden.physics else None,
    )
    start = commands[0][0] - SECOND
    plant, random = Plant(settings, start - 2 * SECOND), np.random.default_rng(hidden.seed)
    if moving:
        for stamp in range(start - 2 * SECOND, commands[0][0], SECOND // 10):
            plant.advance(stamp)
            plant.command(stamp, *np.multiply(hidden.scales, commands[0][1:]))
            if stamp >= start:
                break
    ahead, period, waiting = round(hidden.clock * SECOND), round(SECOND / hidden.rate), [*commands]
    if moving:
        # It goes on with what it was told.
        early = np.arange(start, commands[0][0], SECOND // 10)[1:]
        hidden_commands = {int(at) for at in early}
        waiting = [(int(at), *commands[0][1:]) for at in early] + waiting
    else:
        hidden_commands = set()
    said, half = 0, (commands[0][0] + commands[-1][0]) // 2
    for stamp in range(start, commands[-1][0] + 2 * SECOND, period):
        while waiting and waiting[0][0] <= stamp:
            received, speed, turn = waiting.pop(0)
            plant.advance(received)
            with suppress(TwistError):
                plant.command(received, hidden.scales[0] * speed, hidden.scales[1] * turn)
            message = twist(speed, turn)
            if hidden.stamped:
                message = make(STAMPED, header(said if answering else received), message)
            if received not in hidden_commands:
                yield received, 1, message
        plant.advance(stamp)
        pose = plant.measure()
        if jump is not None and stamp > half:
            pose[:2] += jump
        came = stamp + round((hidden.age + hidden.jitter * random.random()) * SECOND)
        said = stamp + ahead
        yield came, 0, odometry(said, pose, plant.twist)


def truth_of(hidden: Hidden) -> dict[str, tuple[float, float]]:
    """The range in which each true value is, by the key of its estimate.

    Without physics it is one value. What motors and tyres add is measured without noise, at the
    turn rates and speeds of the excitation; as a delay or as a lag, who could tell.
    """
    added, ratios = [0.0], np.ones((2, 1))
    if hidden.physics:
        runs = [[_settled(hidden, axis, part) for part in (0.3, 1.0)] for axis in (0, 1)]
        added = [late - hidden.lag for each in runs for late, _ in each]
        ratios = np.array([[ratio for _, ratio in each] for each in runs])
    low, high = min(added), max(added)
    age = hidden.age + hidden.jitter / 2.0
    delay, lag = hidden.delay + hidden.clock, hidden.lag
    ranges = {
        'delay': (delay, delay + high),
        'lag': (lag, lag + high),
        'together': (delay + lag + low, delay + lag + high),
        'command_delay': (hidden.delay + lag + age + low, hidden.delay + lag + age + high),
        'age': (age - hidden.clock,) * 2,
        'rate': (SECOND / round(SECOND / hidden.rate),) * 2,
        'position': (hidden.noise[0],) * 2,
        'heading': (hidden.noise[1],) * 2,
    }
    for axis, name in enumerate(('linear', 'angular')):
        scales = hidden.scales[axis] * ratios[axis]
        ranges[f'{name}_scale'] = scales.min(), scales.max()
    return ranges


def _settled(hidden: Hidden, axis: int, part: float) -> tuple[float, float]:
    """Lateness of a robot with physics after a step of the command [s], and its scale."""
    robot = DifferentialDrive(wheel_radius=RADIUS, half_track=HALF_TRACK, max_wheel_speed=51.0)
    plant = Plant(
        PlantSettings(
            robot, (0.0, 0.0, 0.0), cmd_vel_timeout=0.0, wheel_lag=hidden.lag, physics=Physics()
        )
    )
    twist, second = [0.0, 0.0], SECOND
    twist[axis] = part * hidden.scales[axis] * hidden.limits[axis]
    plant.advance(second)
    begin = plant.pose
    plant.command(second, *twist)
    travelled = []
    for stamp in (4 * second, 5 * second):
        plant.advance(stamp)
        moved = plant.pose - begin
        travelled.append(moved[2] if axis else moved[0])
    speed = travelled[1] - travelled[0]
    return 3.0 - travelled[0] / speed, speed / twist[axis]
