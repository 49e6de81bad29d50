"""The viewer: the topics of guidance and sim onto a page for a browser."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from rcl_interfaces.msg import ParameterDescriptor
from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.task import Future
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from cmpsp_ros.nodes import viewer_messages as shown
from cmpsp_ros.nodes.common import topics
from cmpsp_ros.nodes.common.runtime import StartupError, run
from cmpsp_ros.nodes.common.topic import steady_timer
from cmpsp_ros.view import SharedState, ViewError, ViewServer
from cmpsp_ros.world.grids import GridError

HOST, PORT = '127.0.0.1', 8765

_PORTS = 10
"""Ports that are tried."""

_TRAIL_STEP = 0.01
"""Way after which a point is added to the path driven [m]."""

_ASK_PERIOD = 0.5
_ASKED = (
    'robot.radius',
    'robot.footprint',
    'robot.wheel_radius',
    'robot.max_wheel_speed',
    'robot.max_steering_angle',
    'final_time',
)


class Viewer(Node):
    """Subscribes, and serves a live page until stopped; it publishes nothing.

    Namespace and parameters of the command line override those given; StartupError where the page
    cannot be served at `host` and `port`.
    """

    def __init__(
        self, namespace: str | None = None, parameters: Mapping[str, Any] | None = None
    ) -> None:
        given = [Parameter(name, value=value) for name, value in (parameters or {}).items()]
        super().__init__('viewer', namespace=namespace, parameter_overrides=given)
        fixed = ParameterDescriptor(read_only=True)
        host = self.declare_parameter('host', HOST, fixed).value
        port = self.declare_parameter('port', PORT, fixed).value
        self._state = SharedState(shown.SERIES)
        self._server = self._serve(host, port)
        self._place: tuple[float, float, float] | None = None
        self._number: tuple[str, float | None] = '', None
        self._robot: Future | None = None
        self._listen()
        # Of a node's services for parameters the only one that changes nothing and is needed.
        self._client = self.create_client(GetParameters, 'guidance/get_parameters')
        # Simulated time may stand still; the page is to know the robot all the same.
        steady_timer(self, _ASK_PERIOD, self._ask)
        self._state.show('namespace', self.get_namespace())
        self._server.start()
        # Not by the logger, which tells the token to all who listen to /rosout.
        sys.stderr.write(f'open {self._server.address} in a browser\n')
        sys.stderr.flush()

    def _serve(self, host: str, port: int) -> ViewServer:
        """Take the port, or the next one that is free."""
        first: ViewError | None = None
        for candidate in range(port, port + (_PORTS if port else 1)):
            try:
                server = ViewServer(self._state, host, candidate)
            except ViewError as error:
                first = first or error
            else:
                if candidate != port:
                    self.get_logger().warning(f'port {port} is taken: port {candidate} instead')
                return server
        msg = f'parameters host, port: {first}'
        raise StartupError(msg)

    def stop(self) -> None:
        """Close the page's port."""
        self._server.close()

    def _listen(self) -> None:
        heard: tuple[tuple[topics.Topic, Callable[[Any], None]], ...] = (
            (topics.GUIDANCE_ODOM, self._on_odometry),
            (topics.DECISION, self._on_decision),
            (topics.PLAN, self._on_plan),
            (topics.MARKERS, self._on_markers),
            (topics.PLAN_MARKERS, self._on_plan_markers),
            (topics.SIM_WHEELS, self._on_wheels),
            (topics.SIGHTING, self._on_sighting),
        )
        for topic, callback in heard:
            name = topic.name.replace('~', topic.node)
            self.create_subscription(topic.type, name, callback, topic.qos)

    def _on_odometry(self, message: Odometry) -> None:
        place = shown.place_of(message)
        if place is None:
            return
        self._state.show('place', place)
        last = self._place
        if last is None or abs(place[0] - last[0]) + abs(place[1] - last[1]) > _TRAIL_STEP:
            self._state.add('path', place[:2])
            self._place = place

    def _on_decision(self, message: DiagnosticArray) -> None:
        decision = shown.decision_of(message)
        number = decision['run'], decision['step']
        if number != self._number and (number[0] != self._number[0] or number[1] == 0):
            self._state.begin()
        self._number = number
        self._state.alive()
        self._state.show('decision', decision)
        self._state.add('steps', shown.step_of(decision))

    def _on_plan(self, message: Path) -> None:
        self._state.show('plan', shown.plan_of(message))

    def _on_markers(self, message: MarkerArray) -> None:
        self._state.show_course(shown.course_of(message))
        # They are sent anew when parameters have changed.
        self._robot = None

    def _on_plan_markers(self, message: MarkerArray) -> None:
        self._state.show('moving', shown.moving_of(message))

    def _on_wheels(self, message: JointState) -> None:
        self._state.show('driven', shown.speeds_of(message))

    def _on_sighting(self, message: OccupancyGrid) -> None:
        with suppress(GridError):
            self._state.show('seen', shown.seen_of(message))

    def _ask(self) -> None:
        """Ask the guidance node for data that no topic carries."""
        if self._robot is None and self._client.service_is_ready():
            self._robot = self._client.call_async(GetParameters.Request(names=list(_ASKED)))
            self._robot.add_done_callback(self._on_parameters)

    def _on_parameters(self, future: Future) -> None:
        values = future.result().values
        if len(values) == len(_ASKED):
            named = zip(_ASKED, map(parameter_value_to_python, values), strict=True)
            self._state.show('robot', dict(named))


def view(host: str, port: int, namespace: str) -> int:
    """Show the nodes of a namespace until SIGINT or SIGTERM; returns exit code."""
    return run(lambda: Viewer(namespace, {'host': host, 'port': port}), name='viewer', args=[])


def main() -> None:
    """Run the viewer as a process."""
    sys.exit(run(Viewer, name='viewer', outlasts=1.0))


if __name__ == '__main__':
    main()
