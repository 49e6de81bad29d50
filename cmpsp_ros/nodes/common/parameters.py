"""The parameter table as parameters of a ROS 2 node."""

from collections.abc import Iterable
from typing import Any, cast

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, ParameterEvent
from rclpy.node import Node
from rclpy.parameter import Parameter

from cmpsp_ros.nodes.common.runtime import overrides
from cmpsp_ros.parameters import TABLE, Values, config_directory
from cmpsp_ros.parameters import Parameter as Row
from cmpsp_ros.parameters.files import with_files

_UNBOUNDED = 1e9  # beyond what any parameter may hold


def declare(node: Node, which: str) -> Values:
    """Declare the parameters that a node uses, and return the complete set of both nodes.

    Both read one file: parameters of the other node are checked as well. rclpy cannot construct
    a node with `automatically_declare_parameters_from_overrides` that is given an empty list.
    Raises ParameterError with all unknown keys and invalid values, before anything is declared.
    """
    # ROS does not say which file a parameter is from: relative paths are those of our presets.
    values = TABLE.resolve(with_files(overrides(node), config_directory()))
    for key, row in TABLE.keys(values):
        if which in row.nodes:
            _declare(node, key, row, values[key])
    return values


def change_parameters(node: Node, changes: dict[str, Any]) -> None:
    """Change parameters of a node together, if they differ; raises ValueError if refused."""
    known = {key: node.get_parameter(key).value for key in changes}
    if all(_plain(known[key]) == value for key, value in changes.items()):
        return
    # An empty list shows no type, and rclpy takes it for one of bytes.
    kinds = {key: Parameter.Type.DOUBLE_ARRAY for key, value in changes.items() if value == []}
    outcome = node.set_parameters_atomically(
        [Parameter(key, kinds.get(key), value) for key, value in changes.items()]
    )
    if not outcome.successful:
        raise ValueError(outcome.reason)


def _plain(value: Any) -> Any:
    return value if isinstance(value, str) or not hasattr(value, '__iter__') else list(value)


def event_of(node: Node, changed: Iterable[Parameter] = ()) -> ParameterEvent:
    """All current parameters of a node, and the names of the changed ones."""
    known = cast('dict[str, Parameter]', node.get_parameters_by_prefix(''))
    return ParameterEvent(
        stamp=node.get_clock().now().to_msg(),
        node=node.get_fully_qualified_name(),
        new_parameters=[each.to_parameter_msg() for each in known.values()],
        changed_parameters=[each.to_parameter_msg() for each in changed],
    )


def _declare(node: Node, key: str, row: Row, value: Any) -> None:
    if node.has_parameter(key):
        # Declared by rclpy from the command line or a file, without words, with a fixed type.
        node.undeclare_parameter(key)
    free = ParameterDescriptor(dynamic_typing=True)
    node.declare_parameter(key, value, free, ignore_override=True)
    kind = Parameter.Type[row.type.name]
    if value == []:
        # An empty list shows no type, and rclpy takes it for one of bytes.
        node.set_parameters([Parameter(key, kind, value)])
    descriptor = ParameterDescriptor(
        description=row.description,
        additional_constraints=row.wanted,
        # A fixed type would be enforced by rclpy, in words that help no one, and refuse 2 for 2.0.
        dynamic_typing=True,
        read_only=not row.reconfigurable,
    )
    low, high = max(row.range.low, -_UNBOUNDED), min(row.range.high, _UNBOUNDED)
    if kind is Parameter.Type.INTEGER:
        bounds = IntegerRange(from_value=int(low), to_value=int(high))
        descriptor.integer_range = [bounds]
    elif kind is Parameter.Type.DOUBLE:
        descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    node.set_descriptor(key, descriptor)
