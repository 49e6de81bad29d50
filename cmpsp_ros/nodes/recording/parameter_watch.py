"""The parameters of all nodes of the graph, with their values when first seen."""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Protocol, cast

from rcl_interfaces.msg import ParameterEvent, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.parameter import parameter_value_to_python
from rclpy.serialization import deserialize_message

from cmpsp_ros.nodes.recording.initial_parameters import InitialParameters

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    from rclpy.client import Client
    from rclpy.node import Node
    from rclpy.parameter import Parameter
    from rclpy.task import Future

ANSWER_TIMEOUT = 2.0
"""Time after which a node that has not answered is asked again [s]."""

SETTLING_TIME = 0.5
"""Time after an answer within which events that are older than it will have come [s]."""


class Report(Protocol):
    """Called with a node's known values each time that more become known."""

    def __call__(self, node: str, values: Mapping[str, Any], since: int, /) -> None:
        """Take them.

        Args:
            node: Full name.
            values: Values by key, as they were before the first change in `/parameter_events`.
            since: When the node was started anew with them [ns]; 0 for those it first had.

        """


@dataclass
class _Inquiry:
    """Requests to a node: first for its parameters' names, then for their values."""

    lister: Client
    getter: Client
    names: list[str] = field(default_factory=list)
    answer: Future | None = None
    asked_at: float = 0.0
    answered_at: float | None = None


@dataclass
class _Life:
    """A node from one start to the next.

    Attributes:
        values: Known values of its parameters.
        since: Time of its restart [ns]; 0 if there was none.
        before: Values that a reader of the bag assumes without further records.
    """

    values: InitialParameters = field(default_factory=InitialParameters)
    since: int = 0
    before: Mapping[str, Any] | None = None


class ParameterWatch:
    """Requests the parameters of every node that appears, without blocking.

    Later changes arrive on `/parameter_events`, to which the owner subscribes before the first
    `poll`: see `hear` and `caught_up`.

    Args:
        node: The node that sends the requests; its own parameters are reported too.
        report: Called with the values of each node. A restarted node is reported only if its values
            differ from those before.
    """

    def __init__(self, node: Node, report: Report) -> None:
        self._node = node
        self._report = report
        self._lives: dict[str, _Life] = {}
        self._present: Counter[str] = Counter()
        self._gone: dict[str, int] = {}
        self._inquiries: dict[str, _Inquiry] = {}

    @property
    def known(self) -> tuple[str, ...]:
        """Nodes whose initial values are known."""
        return tuple(sorted(name for name, life in self._lives.items() if life.values.settled))

    def poll(self) -> None:
        """Find nodes, and begin or continue inquiries; to be called periodically."""
        # A node that was killed stays in the graph for a while, beside the one that follows it.
        present = Counter(
            f'{namespace.rstrip("/")}/{name}'
            for name, namespace in self._node.get_node_names_and_namespaces()
            if not name.startswith('_')
        )
        now = self._node.get_clock().now().nanoseconds
        for name in self._present - present:
            if name not in present:
                self._gone[name] = now
                inquiry = self._inquiries.get(name)
                # What it said before its end still counts.
                if inquiry is not None and inquiry.answered_at is None:
                    self._end_inquiry(name)
        for name in sorted(present - self._present):
            self._begin(name, max(self._gone.pop(name, now), 1))
        self._present = present
        for name in list(self._inquiries):
            self._continue_inquiry(name)

    def hear(self, raw: bytes) -> None:
        """Take a serialised message of `/parameter_events`, in the order of their coming."""
        event = deserialize_message(raw, ParameterEvent)
        life = self._lives.setdefault(event.node, _Life())
        for each in event.new_parameters:
            if each.value.type != ParameterType.PARAMETER_NOT_SET:
                life.values.declared(each.name, _plain(each.value))
        for each in event.changed_parameters:
            life.values.changed(each.name, _plain(each.value))
        self._tell(event.node)

    def caught_up(self) -> None:
        """All events that have arrived by now were processed; to be called periodically."""
        now = time.monotonic()
        for name, inquiry in list(self._inquiries.items()):
            if inquiry.answered_at is not None and now - inquiry.answered_at > SETTLING_TIME:
                self._end_inquiry(name)
                self._settle(name)

    def finish(self) -> None:
        """Report the answers; all events were processed."""
        for name, life in self._lives.items():
            life.values.settle()
            self._tell(name)

    def _begin(self, name: str, since: int) -> None:
        self._end_inquiry(name)
        life = self._lives.setdefault(name, _Life())
        self._settle(name)
        if life.values.settled:
            self._lives[name] = _Life(since=since, before=life.values.latest)
        if name == self._node.get_fully_qualified_name():
            # rclpy declares the values of this mapping, and returns parameters.
            found = cast('dict[str, Parameter]', self._node.get_parameters_by_prefix(''))
            own = ((key, each.get_parameter_value()) for key, each in found.items())
            self._lives[name].values.answered(_set(own))
            self._settle(name)
        else:
            self._inquiries[name] = _Inquiry(
                self._node.create_client(ListParameters, f'{name}/list_parameters'),
                self._node.create_client(GetParameters, f'{name}/get_parameters'),
            )

    def _continue_inquiry(self, name: str) -> None:
        inquiry = self._inquiries[name]
        client = inquiry.getter if inquiry.names else inquiry.lister
        if inquiry.answered_at is not None:
            return
        if inquiry.answer is not None:
            if inquiry.answer.done():
                self._take_answer(name, inquiry)
            elif time.monotonic() - inquiry.asked_at > ANSWER_TIMEOUT:
                client.remove_pending_request(inquiry.answer)
                inquiry.answer = None
        elif client.service_is_ready():
            request = ListParameters.Request()
            if inquiry.names:
                self._lives[name].values.asked()
                request = GetParameters.Request(names=inquiry.names)
            inquiry.asked_at = time.monotonic()
            inquiry.answer = client.call_async(request)
            inquiry.answer.add_done_callback(lambda _: self._take_answer(name, inquiry))

    def _take_answer(self, name: str, inquiry: _Inquiry) -> None:
        if self._inquiries.get(name) is not inquiry or inquiry.answer is None:
            return
        answer = inquiry.answer.result()
        inquiry.answer = None
        if not inquiry.names:
            inquiry.names = list(answer.result.names)
            if inquiry.names:
                self._continue_inquiry(name)
            else:
                self._end_inquiry(name)
        elif len(answer.values) == len(inquiry.names):
            values = _set(zip(inquiry.names, answer.values, strict=True))
            self._lives[name].values.answered(values)
            inquiry.answered_at = time.monotonic()
        else:
            # One of them has gone since: some nodes then answer with nothing.
            inquiry.names = []

    def _end_inquiry(self, name: str) -> None:
        inquiry = self._inquiries.pop(name, None)
        if inquiry is not None:
            self._node.destroy_client(inquiry.lister)
            self._node.destroy_client(inquiry.getter)

    def _settle(self, name: str) -> None:
        self._lives[name].values.settle()
        self._tell(name)

    def _tell(self, name: str) -> None:
        life = self._lives[name]
        values = life.values.known
        if not values:
            return
        if life.before is None:
            self._report(name, values, 0)
        elif life.values.settled and any(
            key not in values or repr(values[key]) != repr(life.before.get(key))
            for key in life.values.latest
        ):
            self._report(name, values, life.since)


def _set(values: Iterable[tuple[str, ParameterValue]]) -> dict[str, Any]:
    """Those that have a value."""
    return {
        key: _plain(value) for key, value in values if value.type != ParameterType.PARAMETER_NOT_SET
    }


def _plain(value: ParameterValue) -> Any:
    if value.type == ParameterType.PARAMETER_BYTE_ARRAY:
        return [each[0] for each in value.byte_array_value]
    return parameter_value_to_python(value)
