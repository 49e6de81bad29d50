"""The viewer: the topics of guidance and sim onto a page for a browser.

Anybody may publish on them: what is shown is of bounded size, so that no message makes it slow.
"""

import math
import sys
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial
from typing import Any, Final

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import OccupancyGrid, Odometry, Path
from rcl_interfaces.msg import ParameterDescriptor
from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.task import Future
from sensor_msgs.msg import JointState
from visualization_msgs.msg import Marker, MarkerArray

from cmpsp_ros.guidance import DECISION_KEYS, NANOSECONDS, Key
from cmpsp_ros.nodes.common import topics
from cmpsp_ros.nodes.common.runtime import StartupError, run
from cmpsp_ros.nodes.common.topic import steady_timer
from cmpsp_ros.sensing import grid_of
from cmpsp_ros.view import SharedState, ViewError, ViewServer, grid_picture
from cmpsp_ros.world.grids import GridError
from cmpsp_ros.world.roads import FAR

HOST, PORT = '127.0.0.1', 8765

_PORTS = 10  # ports that are tried
_TRAIL_STEP = 0.01  # way after which a point is added to the path driven [m]
_ASK_PERIOD = 0.5
_ASKED = (
    'robot.radius',
    'robot.footprint',
    'robot.wheel_radius',
    'robot.max_wheel_speed',
    'robot.max_steering_angle',
    'final_time',
    'follow.speed',
)


class Viewer(Node):
    """Subscribes, and serves a live page until stopped; StartupError without a free port."""

    def __init__(
        self, namespace: str | None = None, parameters: Mapping[str, Any] | None = None
    ) -> None:
        given = [Parameter(name, value=value) for name, value in (parameters or {}).items()]
        super().__init__('viewer', namespace=namespace, parameter_overrides=given)
        fixed = ParameterDescriptor(read_only=True)
        host = self.declare_parameter('host', HOST, fixed).value
        port = self.declare_parameter('port', PORT, fixed).value
        self._state = SharedState(SERIES)
        self._server = self._serve(host, port)
        self._place: tuple[float, float, float] | None = None
        self._number: tuple[str, float | None] = '', None
        self._begun: float | None = None  # time 0 of the run, or when it was first seen [s]
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
        raise StartupError(f'parameters host, port: {first}')

    def stop(self) -> None:
        """Close the page's port."""
        self._server.close()

    def _listen(self) -> None:
        heard: tuple[tuple[topics.Topic, Callable[[Any], None]], ...] = (
            (topics.GUIDANCE_ODOM, self._on_odometry),
            (topics.DECISION, self._on_decision),
            (topics.PLAN, partial(self._show, 'plan', plan_of)),
            (topics.MARKERS, self._on_markers),
            (topics.PLAN_MARKERS, partial(self._show, 'moving', moving_of)),
            (topics.SIM_WHEELS, partial(self._show, 'driven', speeds_of)),
            (topics.SIGHTING, partial(self._show, 'seen', seen_of)),
        )
        for topic, callback in heard:
            name = topic.name.replace('~', topic.node)
            self.create_subscription(topic.type, name, callback, topic.qos)

    def _on_odometry(self, message: Odometry) -> None:
        place = place_of(message)
        if place is None:
            return
        self._state.show('place', place)
        last = self._place
        if last is None or abs(place[0] - last[0]) + abs(place[1] - last[1]) > _TRAIL_STEP:
            self._state.add('path', place[:2])
            self._place = place

    def _on_decision(self, message: DiagnosticArray) -> None:
        decision = decision_of(message)
        number = decision['run'], decision['step']
        if number != self._number and (number[0] != self._number[0] or number[1] == 0):
            self._state.begin()
            self._begun = None
        self._number = number
        # The node may have to wait before: time 0 is that of the first step.
        if self._begun is None and not decision['halted']:
            self._begun = decision['stamp']
        decision['time'] = None if self._begun is None else decision['stamp'] - self._begun
        self._state.alive()
        self._state.show('decision', decision)
        self._state.add('steps', step_of(decision))

    def _on_markers(self, message: MarkerArray) -> None:
        self._state.show_course(course_of(message))
        # They are sent anew when parameters have changed.
        self._robot = None

    def _show(self, name: str, convert: Callable[[Any], Any], message: Any) -> None:
        with suppress(GridError):
            self._state.show(name, convert(message))

    def _ask(self) -> None:
        if self._robot is None and self._client.service_is_ready():
            self._robot = self._client.call_async(GetParameters.Request(names=list(_ASKED)))
            self._robot.add_done_callback(self._on_parameters)

    def _on_parameters(self, future: Future) -> None:
        values = future.result().values
        if len(values) == len(_ASKED):
            named = zip(_ASKED, map(parameter_value_to_python, values), strict=True)
            self._state.show('robot', dict(named))


SERIES: Final = ('path', 'steps')  # series kept row by row: (x, y); and `step_of` each decision
_SHOWN: Final = {**DECISION_KEYS, 'step_ms': Key(float)}
_MOST_MARKERS: Final = 500
_MOST_POINTS: Final = 2000
_MOST_WHEELS: Final = 8
_LONGEST_TEXT: Final = 500
_KINDS: Final = {
    Marker.LINE_STRIP: 'line',
    Marker.CYLINDER: 'disc',
    Marker.TEXT_VIEW_FACING: 'text',
}


def place_of(message: Odometry) -> tuple[float, float, float] | None:
    """Pose (x, y, heading) [m, m, rad]; None if not finite."""
    position, q = message.pose.pose.position, message.pose.pose.orientation
    heading = math.atan2(2.0 * (q.w * q.z + q.x * q.y), q.w**2 + q.x**2 - q.y**2 - q.z**2)
    place = (position.x, position.y, heading)
    return place if all(map(math.isfinite, place)) else None


def decision_of(message: DiagnosticArray) -> dict[str, Any]:
    """A decision by key; missing values are None. After the final time its level is `arrived`."""
    # Of anybody's making: an array of none is a decision that lacks everything.
    status = next(iter(message.status), DiagnosticStatus())
    texts = {each.key: _short(each.value) for each in status.values}
    shown = {key: _value(each, texts.get(key)) for key, each in _SHOWN.items()}
    for each in ('clearance', 'worst_clearance'):
        # nothing to measure it to
        if shown[each] is not None and shown[each] >= FAR:
            shown[each] = None
    shown['reason'] = _short(status.message)
    shown['stamp'] = message.header.stamp.sec + message.header.stamp.nanosec / NANOSECONDS
    two = shown['wheel_speed_right'], shown['wheel_speed_left']
    shown['wheels'] = list(shown['wheel_speeds'] or two)[:_MOST_WHEELS]
    missed = shown['missed'] or shown['halted']
    shown['level'] = 'arrived' if shown['finished'] and not missed else shown['fallback_level']
    return shown


def _value(key: Key, text: str | None) -> Any:
    try:
        return None if text is None else key.parse(text)
    except ValueError:
        return None


def step_of(decision: dict[str, Any]) -> list[Any]:
    """Time in the run, wheel speeds and the steering angle of a car, clearance and level."""
    angle = decision['steering_angle']
    controls = [*decision['wheels'], *(() if angle is None else (angle,))]
    return [decision['time'], *controls, decision['clearance'], decision['level']]


def plan_of(message: Path) -> list[list[float]]:
    """Points (x, y) [m] of a plan."""
    places = (each.pose.position for each in message.poses[:_MOST_POINTS])
    return [[each.x, each.y] for each in places]


def seen_of(message: OccupancyGrid) -> dict[str, Any]:
    """The picture of a grid, or GridError where it is none, or turned."""
    grid = grid_of(message, message.header.frame_id)
    if grid.origin[2] != 0.0:
        raise GridError('origin', f'{grid.origin[2]} rad', 'a grid along the axes')
    return grid_picture(grid)


def speeds_of(message: JointState) -> list[float]:
    """Speeds of all wheels [rad/s]."""
    return list(message.velocity[:_MOST_WHEELS])


def course_of(message: MarkerArray) -> list[dict[str, Any]]:
    """Lines, discs and texts to draw, in their order, each in its colour."""
    kinds = ((_KINDS.get(each.type), each) for each in message.markers[:_MOST_MARKERS])
    return [
        {
            'kind': kind,
            'of': _short(each.ns),
            'at': [each.pose.position.x, each.pose.position.y],
            'size': each.scale.x,
            'color': [each.color.r, each.color.g, each.color.b, each.color.a],
            'points': [[point.x, point.y] for point in each.points[:_MOST_POINTS]],
            'text': _short(each.text),
        }
        for kind, each in kinds
        if kind is not None and each.action == Marker.ADD
    ]


def moving_of(message: MarkerArray) -> list[dict[str, Any]]:
    """Moving obstacles among markers: position, diameters of body and doubt, and destination."""
    there = [each for each in message.markers[:_MOST_MARKERS] if each.action == Marker.ADD]
    ways = {each.id: each.points[-1] for each in there if each.type == Marker.ARROW and each.points}
    doubts = {each.id: each.scale.x for each in there if each.ns == 'moving_doubts'}
    return [
        {
            'at': [each.pose.position.x, each.pose.position.y],
            'size': each.scale.x,
            'doubt': doubts.get(each.id),
            'to': [ways[each.id].x, ways[each.id].y] if each.id in ways else None,
        }
        for each in there
        if each.ns == 'moving_obstacles'
    ]


def _short(text: str) -> str:
    return text[:_LONGEST_TEXT]


def view(host: str, port: int, namespace: str) -> int:
    """Show the nodes of a namespace until SIGINT or SIGTERM; returns exit code."""
    return run(lambda: Viewer(namespace, {'host': host, 'port': port}), name='viewer', args=[])


def main() -> None:
    """Run the viewer as a process."""
    sys.exit(run(Viewer, name='viewer', outlasts=1.0))


if __name__ == '__main__':
    main()
