# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
A node's parameters, declared by a frozen dataclass: the only place that knows their defaults.

A field made by ``parameter`` is a ROS parameter of its name; a field that is such a dataclass
itself is a group: ``options.marker.size_m`` is the parameter ``marker.size_m``.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
import dataclasses
from difflib import get_close_matches
from typing import Any, Generic, TypeVar

from p4pfr_ros.files.yaml_fields import ConfigError
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import InvalidParameterTypeException, ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter

Options = TypeVar('Options')
Value = TypeVar('Value', bool, int, float, str)

# What ROS itself declares on any node; qos_overrides.py looks after the overrides.
_OF_ROS = ('use_sim_time', 'qos_overrides.', 'start_type_description_service')


@dataclasses.dataclass(frozen=True, slots=True)
class Spec:
    """What is known of a parameter beside its name and default; the range holds both ends."""

    description: str
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    read_only: bool = False


def parameter(
    default: Value,
    description: str,
    *,
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] = (),
    read_only: bool = False,
) -> Value:
    """
    Make a field of an options dataclass that is a ROS parameter.

    Numbers lie in the range from ``low`` to ``high``, both included; a text is one of
    ``choices`` where they are given. A ``read_only`` parameter is set when the node starts and
    never again; any other takes effect with the next message.
    """
    spec = Spec(description, low, high, choices, read_only)
    made: Value = dataclasses.field(default=default, metadata={'spec': spec})
    return made


def flattened(options: Any, prefix: str = '') -> Iterator[tuple[str, Any, Spec]]:
    """Yield (name, value, spec) of each parameter of an options dataclass."""
    for field in dataclasses.fields(options):
        value = getattr(options, field.name)
        if dataclasses.is_dataclass(value):
            yield from flattened(value, f'{prefix}{field.name}.')
        else:
            yield prefix + field.name, value, field.metadata['spec']


def replaced(options: Options, values: Mapping[str, Any]) -> Options:
    """
    Return the options with some parameters, by their names, set to new values.

    Raises
    ------
    ConfigError
        A text is none of its choices, or two parameters do not go together.

    """
    for name, _, spec in flattened(options):
        if spec.choices and values.get(name, spec.choices[0]) not in spec.choices:
            expected = ', '.join(spec.choices)
            raise ConfigError(f'{name}: expected one of {expected}, got {values[name]!r}')
    new: Options = _rebuilt(options, values, '')
    return new


def given_parameters(node: Node) -> Mapping[str, Parameter]:
    """Return what a node was given at its start, by names, be it declared or not."""
    # rclpy keeps it where a node's subclasses can see it, and has no public way to it.
    given: Mapping[str, Parameter] = getattr(node, '_parameter_overrides', {})
    return given


def warn_of_unknown(node: Node, given: Iterable[str], known: Collection[str]) -> None:
    """Say which names are none of the known ones: misspelt, most likely."""
    for name in given:
        if name not in known:
            near = get_close_matches(name, known, n=1)
            hint = f' (did you mean {near[0]}?)' if near else ''
            node.get_logger().warning(f'unknown parameter {name} is ignored{hint}')


class Parameters(Generic[Options]):
    """
    Declares a node's parameters, validates each change with a reason, and holds their values.

    ``options`` is a frozen snapshot, replaced as a whole, so it is consistent at any time.

    Raises
    ------
    ConfigError
        A value given at the start is wrong: names node, parameter and what was expected.

    """

    def __init__(self, node: Node, defaults: Options) -> None:
        self._node = node
        self._check: Callable[[Options], None] | None = None
        self._names = [name for name, _, _ in flattened(defaults)]
        try:
            values = {name: self._declare(name, *rest) for name, *rest in flattened(defaults)}
            self.options = replaced(defaults, values)
        except ConfigError as error:
            raise ConfigError(f'{node.get_name()}: {error}') from None
        given = [name for name in given_parameters(node) if not name.startswith(_OF_ROS)]
        warn_of_unknown(node, given, self._names)
        node.add_on_set_parameters_callback(self._validate)
        node.add_post_set_parameters_callback(self._take)

    def guard(self, check: Callable[[Options], None] | None) -> None:
        """
        Hold the values against something that only the node knows, now and at each change.

        Raises
        ------
        ConfigError
            What ``check`` raises of the values as they are: names the node.

        """
        if check is not None:
            try:
                check(self.options)
            except ConfigError as error:
                raise ConfigError(f'{self._node.get_name()}: {error}') from None
        self._check = check

    def _declare(self, name: str, default: Any, spec: Spec) -> Any:
        try:
            return self._node.declare_parameter(name, default, _descriptor(default, spec)).value
        except ParameterException as error:  # of another type, or out of range
            is_type = isinstance(error, InvalidParameterTypeException)
            hint = ' (write 1.0, not 1)' if is_type and isinstance(default, float) else ''
            raise ConfigError(f'{name}: {error}{hint}') from None

    def _validate(self, changes: list[Parameter]) -> SetParametersResult:
        try:
            new = replaced(self.options, self._ours(changes))
            if self._check is not None:
                self._check(new)
        except ConfigError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _take(self, changes: list[Parameter]) -> None:
        self.options = replaced(self.options, self._ours(changes))

    def _ours(self, changes: list[Parameter]) -> dict[str, Any]:
        return {p.name: p.value for p in changes if p.name in self._names}


def _rebuilt(options: Any, values: Mapping[str, Any], prefix: str) -> Any:
    """Build the dataclass anew, groups first, so that each checks itself again."""
    changed = {}
    for field in dataclasses.fields(options):
        name, value = prefix + field.name, getattr(options, field.name)
        if dataclasses.is_dataclass(value):
            changed[field.name] = _rebuilt(value, values, f'{name}.')
        else:
            changed[field.name] = values.get(name, value)
    return type(options)(**changed)


def _descriptor(default: Any, spec: Spec) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(description=spec.description, read_only=spec.read_only)
    if spec.choices:
        descriptor.additional_constraints = 'one of ' + ', '.join(spec.choices)
    if spec.low is not None and spec.high is not None:
        if isinstance(default, int):
            steps = IntegerRange(from_value=int(spec.low), to_value=int(spec.high), step=1)
            descriptor.integer_range = [steps]
        else:
            span = FloatingPointRange(from_value=float(spec.low), to_value=float(spec.high))
            descriptor.floating_point_range = [span]
    return descriptor
