"""The parameters of all nodes of the graph, with the values they had at first sight."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, cast

from rcl_interfaces.msg import ParameterEvent, ParameterType, ParameterValue
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.parameter import parameter_value_to_python
from rclpy.serialization import deserialize_message

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from rclpy.client import Client
    from rclpy.node import Node
    from rclpy.parameter import Parameter
    from rclpy.task import Future

ANSWER_TIMEOUT = 2.0
"""Time after which a node that has not answered is asked again [s]."""


@dataclass
class _Inquiry:
    """A node being asked: first for its parameters' names, then for their values."""

    lister: Client
    getter: Client
    names: list[str] = field(default_factory=list)
    answer: Future | None = None
    asked_at: float = 0.0


class ParameterWatch:
    """Asks every node that appears for its parameters, without ever waiting.

    Args:
        node: The node that asks; its own parameters are reported too.
        report: Called with a node's full name and all its values known so far, each time one
            comes to be known. A value once known stays as it is: later changes are for those who
            listen to `/parameter_events`.

    """

    def __init__(self, node: Node, report: Callable[[str, dict[str, Any]], None]) -> None:
        self._node = node
        self._report = report
        self._known: dict[str, dict[str, Any]] = {}
        self._present: set[str] = set()
        self._inquiries: dict[str, _Inquiry] = {}

    def poll(self) -> None:
        """Look who is there, begin and go on with inquiries; to be called periodically."""
        present = {
            f'{namespace.rstrip("/")}/{name}'
            for name, namespace in self._node.get_node_names_and_namespaces()
            if not name.startswith('_')
        }
        own = self._node.get_fully_qualified_name()
        for name in sorted(present - self._present):
            if name == own:
                # rclpy declares the values of this mapping, and returns parameters.
                found = cast('dict[str, Parameter]', self._node.get_parameters_by_prefix(''))
                self._learn(own, ((key, each.get_parameter_value()) for key, each in found.items()))
            else:
                self._inquiries[name] = _Inquiry(
                    self._node.create_client(ListParameters, f'{name}/list_parameters'),
                    self._node.create_client(GetParameters, f'{name}/get_parameters'),
                )
        for name in self._present - present:
            self._end_inquiry(name)
        self._present = present
        for name in list(self._inquiries):
            self._continue_inquiry(name)

    def hear(self, raw: bytes) -> None:
        """Take a serialised message of `/parameter_events`: parameters declared late are in it."""
        event = deserialize_message(raw, ParameterEvent)
        self._learn(event.node, ((each.name, each.value) for each in event.new_parameters))

    def _continue_inquiry(self, name: str) -> None:
        inquiry = self._inquiries[name]
        client = inquiry.getter if inquiry.names else inquiry.lister
        if inquiry.answer is not None:
            if inquiry.answer.done():
                self._take_answer(name, inquiry)
            elif time.monotonic() - inquiry.asked_at > ANSWER_TIMEOUT:
                client.remove_pending_request(inquiry.answer)
                inquiry.answer = None
        elif client.service_is_ready():
            request = (
                GetParameters.Request(names=inquiry.names)
                if inquiry.names
                else ListParameters.Request()
            )
            inquiry.asked_at = time.monotonic()
            inquiry.answer = client.call_async(request)
            inquiry.answer.add_done_callback(lambda _: self._take_answer(name, inquiry))

    def _take_answer(self, name: str, inquiry: _Inquiry) -> None:
        if self._inquiries.get(name) is not inquiry or inquiry.answer is None:
            return
        answer = inquiry.answer.result()
        inquiry.answer = None
        if not inquiry.names and answer.result.names:
            inquiry.names = list(answer.result.names)
            self._continue_inquiry(name)
            return
        if inquiry.names:
            self._learn(name, zip(inquiry.names, answer.values, strict=True))
        self._end_inquiry(name)

    def _end_inquiry(self, name: str) -> None:
        inquiry = self._inquiries.pop(name, None)
        if inquiry is not None:
            self._node.destroy_client(inquiry.lister)
            self._node.destroy_client(inquiry.getter)

    def _learn(self, name: str, values: Iterable[tuple[str, ParameterValue]]) -> None:
        known = self._known.setdefault(name, {})
        for key, value in values:
            if value.type != ParameterType.PARAMETER_NOT_SET:
                known.setdefault(key, _plain(value))
        self._report(name, known)


def _plain(value: ParameterValue) -> Any:
    if value.type == ParameterType.PARAMETER_BYTE_ARRAY:
        return [each[0] for each in value.byte_array_value]
    return parameter_value_to_python(value)
