"""The drive that shows how a robot responds: commands in the open loop, with a guard around it."""

import math
import signal
import time
from pathlib import Path

from geometry_msgs.msg import Twist, TwistStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.serialization import deserialize_message, serialize_message

from cmpsp_ros.arrays import Array
from cmpsp_ros.bags import BagError, BagWriter
from cmpsp_ros.bags.identify import RADIUS
from cmpsp_ros.guidance.messages import OdometryError, OdometryReading
from cmpsp_ros.nodes.common.runtime import StartupError, run
from cmpsp_ros.nodes.common.topic import steady_timer
from cmpsp_ros.nodes.common.topics import COMMAND, GUIDANCE_ODOM

Commands = tuple[Array, Array]

PERIOD = 0.05  # time between two commands [s]
ODOMETRY_TIMEOUT = 0.5  # age of odometry at which the robot is stopped [s]
WAIT = 10.0  # longest wait for odometry and for a subscriber to commands [s]
REST = 1.0  # time for which the robot is recorded before and after the drive [s]
_TYPES = {'geometry_msgs/msg/Twist': Twist, 'geometry_msgs/msg/TwistStamped': TwistStamped}


class Excitation(Node):
    """Drives once, records itself, and ends its process; `problem` is why it was cut short."""

    def __init__(self, bag: Path, odom: str, cmd_vel: str, commands: Commands) -> None:
        super().__init__('excitation')
        self.problem = 'interrupted, and the robot was stopped'
        self._ends, self._twists = (each.tolist() for each in commands)
        self._odom, self._cmd_vel = map(self.resolve_topic_name, (odom, cmd_vel))
        try:
            self._bag = BagWriter(bag)
            self._bag.topic(self._odom, 'nav_msgs/msg/Odometry')
        except BagError as error:
            raise StartupError(str(error)) from error
        self._output: Publisher | None = None
        self._made, self._begun, self._heard = time.monotonic(), math.inf, -math.inf
        self._place, self._start = (math.nan, math.nan), (math.nan, math.nan)
        quality = GUIDANCE_ODOM.qos
        self.create_subscription(Odometry, self._odom, self._on_odometry, quality, raw=True)
        self._timer = steady_timer(self, PERIOD, self._tick)

    def stop(self) -> None:
        """Stop the robot, and close the bag."""
        try:
            self._command(0.0, 0.0)
        finally:
            self._bag.close()

    def _on_odometry(self, raw: bytes) -> None:
        self._bag.write(self._odom, time.time_ns(), raw)
        message = deserialize_message(raw, Odometry)
        try:
            x, y, _ = OdometryReading.of(message).pose_in(message.header.frame_id).tolist()
        except OdometryError as error:
            self._finish(str(error))
            return
        self._heard, self._place = time.monotonic(), (x, y)
        if (away := math.dist(self._place, self._start)) > RADIUS:
            self._finish(f'found the robot {away:.2f} m from its start, wanted {RADIUS:g} m')

    def _tick(self) -> None:
        now = time.monotonic()
        age, since = now - self._heard, now - self._begun
        if self._output is None:
            self._look(now)
        elif age > ODOMETRY_TIMEOUT:
            self._finish(f'found no odometry on {self._odom} for {age:.2f} s')
        elif self.count_publishers(self._cmd_vel) > 1:
            self._finish(f'found another publisher of {self._cmd_vel}, wanted none')
        elif (robots := self.count_publishers(self._odom)) > 1:
            self._finish(f'found {robots} publishers of {self._odom}, wanted one robot')
        else:
            phase = next((k for k, end in enumerate(self._ends) if since < end), None)
            self._command(*((0.0, 0.0) if phase is None else self._twists[phase]))
            if since > self._ends[-1] + REST:
                self._finish('')

    def _look(self, now: float) -> None:
        """Begin once there is odometry, and a robot that hears commands."""
        kinds = {each.topic_type for each in self.get_subscriptions_info_by_topic(self._cmd_vel)}
        has_odometry = self._heard > -math.inf
        if has_odometry and len(kinds) == 1 and kinds <= _TYPES.keys():
            (kind,) = kinds
            self._bag.topic(self._cmd_vel, kind)
            self._output = self.create_publisher(_TYPES[kind], self._cmd_vel, COMMAND.qos)
            self._start, self._begun = self._place, now + REST
        elif now - self._made > WAIT:
            odometry = 'odometry' if has_odometry else 'no odometry'
            self._finish(
                f'found {odometry} on {self._odom}, and {", ".join(sorted(kinds)) or "no robot"} to'
                f' hear {self._cmd_vel}, wanted both, and one type of {" or ".join(_TYPES)}'
            )

    def _command(self, speed: float, turn: float) -> None:
        if self._output is None:
            return
        stamped = TwistStamped()
        stamped.header.stamp = self.get_clock().now().to_msg()
        stamped.twist.linear.x, stamped.twist.angular.z = float(speed), float(turn)
        is_stamped = self._output.msg_type is TwistStamped
        raw = serialize_message(stamped if is_stamped else stamped.twist)
        self._output.publish(raw)
        self._bag.write(self._cmd_vel, time.time_ns(), raw)

    def _finish(self, problem: str) -> None:
        if not self._timer.is_canceled():
            self._timer.cancel()
            self.problem = problem
            self._command(0.0, 0.0)
            # This exit delivers the last published messages.
            signal.raise_signal(signal.SIGINT)


def drive(bag: Path, odom: str, cmd_vel: str, commands: Commands) -> str:
    """Drive and record a robot by ends of phases [s] and twists; why that was cut short, if so."""
    nodes: list[Excitation] = []

    def make() -> Excitation:
        nodes.append(Excitation(bag, odom, cmd_vel, commands))
        return nodes[0]

    before = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    failed = run(make, name='excitation', args=[])
    for number, handler in before.items():
        signal.signal(number, handler)
    problem = nodes[0].problem if nodes else 'the drive could not begin'
    return problem or ('the drive did not end well' if failed else '')
