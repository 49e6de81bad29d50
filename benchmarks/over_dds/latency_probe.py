"""A stand-in for the robot that times the way from its odometry to the command that answers it."""

import json
import math
import sys
import time
from pathlib import Path
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.time import Time

from cmpsp_ros.nodes.common import SIM_ODOM, SIM_STAMPED_COMMAND, StartupError, run
from cmpsp_ros.parameters import TABLE, check_simulation, load_parameter_file, plant_settings
from cmpsp_ros.simulator import Plant

_NS = 1_000_000_000
_DECISION = '/guidance/decision'


class _Sent(NamedTuple):
    """Odometry that has left."""

    at_ns: int
    position: tuple[float, float]


class LatencyProbe(Node):
    """Publishes odometry on an exact time grid, obeys the commands, and notes when they came.

    It does no more than that, so that it receives each command at once. When the guidance node
    reports the end of the run, it writes its measurements and idles.

    Raises:
        ParameterError: `parameters` is no preset and no good file.
        StartupError: `output` is missing.
    """

    def __init__(self) -> None:
        super().__init__('latency_probe')
        self._output = Path(self.declare_parameter('output', '').value)
        if self._output == Path():
            raise StartupError('parameter output: expected a file to write to, got nothing')
        source = self.declare_parameter('parameters', 'case3').value
        values = TABLE.resolve(load_parameter_file(source))
        check_simulation(values)
        settings = plant_settings(values)
        self._frame_id: str = values['frame_id']
        self._goal: list[float] = values['goal.position']
        self._sent: dict[int, _Sent] = {}
        self._heard_ns: dict[int, int] = {}
        self._own_ms: dict[int, float] = {}
        self._odometry = SIM_ODOM.publish_on(self)
        SIM_STAMPED_COMMAND.listen_on(self, self._on_command, raw=True)
        self.create_subscription(DiagnosticArray, _DECISION, self._on_decision, 100)

        # The first motion compiles the kinematics, which must not count as time that passes.
        _ = Plant(settings).motion
        self._period_ns = round(_NS / settings.odom_rate)
        self._start_ns, self._begun_ns = time.time_ns(), time.monotonic_ns()
        self._next_ns = self._start_ns
        self._plant = Plant(settings, self._start_ns)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = self.create_timer(0.0, self._on_timer, clock=steady)

    def _on_timer(self) -> None:
        self._publish_due()
        # Armed anew for every instant: a period of its own would drift against the grid.
        self._timer.timer_period_ns = max(1, self._next_ns - self._clock_ns())
        self._timer.reset()

    def _publish_due(self) -> None:
        while self._next_ns <= self._clock_ns():
            self._plant.advance(self._next_ns)
            # Bytes, both ways: conversion to Python objects is no cost of a robot's driver.
            data = serialize_message(self._measure(self._next_ns))
            x, y, _ = self._plant.pose.tolist()
            self._sent[self._next_ns] = _Sent(time.monotonic_ns(), (x, y))
            self._odometry.publish(data)
            self._next_ns += self._period_ns

    def _measure(self, stamp_ns: int) -> Odometry:
        message = Odometry(child_frame_id='base_link')
        message.header.stamp = Time(nanoseconds=stamp_ns).to_msg()
        message.header.frame_id = self._frame_id
        x, y, heading = self._plant.pose.tolist()
        message.pose.pose.position.x, message.pose.pose.position.y = x, y
        message.pose.pose.orientation.z = math.sin(heading / 2.0)
        message.pose.pose.orientation.w = math.cos(heading / 2.0)
        return message

    def _on_command(self, data: bytes) -> None:
        now_ns = time.monotonic_ns()
        message = deserialize_message(data, TwistStamped)
        self._heard_ns[Time.from_msg(message.header.stamp).nanoseconds] = now_ns
        self._publish_due()
        self._plant.advance(self._clock_ns())
        self._plant.command(self._plant.stamp_ns, message.twist.linear.x, message.twist.angular.z)

    def _on_decision(self, message: DiagnosticArray) -> None:
        values = {each.key: each.value for each in message.status[0].values}
        stamp_ns = int(values['stamp'])
        if (values['finished'], values['halted']) == ('true', 'false'):
            self._write(stamp_ns)
        elif 'step_ms' in values:
            self._own_ms[stamp_ns] = float(values['step_ms'])

    def _write(self, last_ns: int) -> None:
        """Leave the measurements in a file that appears complete or not at all."""
        if self._output.exists():
            return
        answered = [stamp for stamp in self._own_ms if stamp in self._heard_ns]
        content = {
            'total_ms': [
                (self._heard_ns[stamp] - self._sent[stamp].at_ns) * 1e-6 for stamp in answered
            ],
            'own_ms': [self._own_ms[stamp] for stamp in answered],
            'miss_m': math.dist(self._sent[last_ns].position, self._goal),
        }
        part = self._output.with_suffix('.part')
        part.write_text(json.dumps(content) + '\n', encoding='utf-8')
        part.replace(self._output)

    def _clock_ns(self) -> int:
        return self._start_ns + (time.monotonic_ns() - self._begun_ns)


def main() -> None:
    """Run the probe until it is stopped."""
    sys.exit(run(LatencyProbe, name='latency_probe'))


if __name__ == '__main__':
    main()
