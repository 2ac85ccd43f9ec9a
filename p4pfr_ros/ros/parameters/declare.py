# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Declares the parameters of a node from a frozen dataclass, which holds their defaults.

A field made by ``parameter``, or by ``option`` of the core, is a ROS parameter with the name of
the field. A field whose value is another such dataclass is a group: ``options.marker.size_m`` is
the parameter ``marker.size_m``. A core option with the default None is 0.0 in ROS: not given.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
import dataclasses
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

from ..runtime.overrides import given_parameters, warn_of_unknown

Options = TypeVar('Options')
Value = TypeVar('Value', bool, int, float, str)

# Parameters that ROS declares for any node; runtime/overrides.py handles qos_overrides.
_DECLARED_BY_ROS = ('use_sim_time', 'qos_overrides.', 'start_type_description_service')

_NOT_GIVEN = 0.0

_READ_ONLY_IF_MANAGED = 'read-only once the node is configured, until cleanup'


@dataclasses.dataclass(frozen=True, slots=True)
class Spec:
    """Description and valid values of a parameter; the range includes both ends."""

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

    Valid numbers are from ``low`` to ``high``, both included; valid texts are the ``choices``, if
    there are any. A ``read_only`` parameter can only be set when the node starts, or before a
    lifecycle node is configured; any other change takes effect with the next message.
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
            yield prefix + field.name, _NOT_GIVEN if value is None else value, _spec_of(field)


def replaced(options: Options, values: Mapping[str, Any]) -> Options:
    """
    Return the options with new values for some parameters, by name.

    Raises
    ------
    ConfigError
        A text is not one of its choices, or two parameters contradict each other.

    """
    for name, _, spec in flattened(options):
        if spec.choices and values.get(name, spec.choices[0]) not in spec.choices:
            expected = ', '.join(spec.choices)
            raise ConfigError(f'{name}: expected one of {expected}, got {values[name]!r}')
    new: Options = _rebuilt(options, values, '')
    return new


class Parameters(Generic[Options]):
    """
    Declares the parameters of a node, validates changes and holds the current values.

    ``options`` is an immutable snapshot that each change replaces, so it is always consistent.

    Parameters
    ----------
    node
        The node.
    defaults
        The options with their defaults.
    managed
        Whether the node is a lifecycle node: its read-only parameters can be changed unless it is
        configured, that is, unless it has a ``guard``.

    Raises
    ------
    ConfigError
        A value given at the start is invalid; the message names node and parameter.

    """

    def __init__(self, node: Node, defaults: Options, *, managed: bool = False) -> None:
        self._node, self._managed = node, managed
        self._check: Callable[[Options], None] | None = None
        self._names = [name for name, _, _ in flattened(defaults)]
        self._read_only = [name for name, _, spec in flattened(defaults) if spec.read_only]
        try:
            values = {name: self._declare(name, *rest) for name, *rest in flattened(defaults)}
            self.options = replaced(defaults, values)
        except ConfigError as error:
            raise ConfigError(f'{node.get_name()}: {error}') from None
        given = [name for name in given_parameters(node) if not name.startswith(_DECLARED_BY_ROS)]
        warn_of_unknown(node, given, self._names)
        node.add_on_set_parameters_callback(self._validate)
        node.add_post_set_parameters_callback(self._apply)

    def guard(self, check: Callable[[Options], None] | None) -> None:
        """
        Add a check that depends on the state of the node, for now and for later changes.

        None removes it.

        Raises
        ------
        ConfigError
            ``check`` raised it for the current values; the message names the node.

        """
        if check is not None:
            try:
                check(self.options)
            except ConfigError as error:
                raise ConfigError(f'{self._node.get_name()}: {error}') from None
        self._check = check

    def _declare(self, name: str, default: Any, spec: Spec) -> Any:
        try:
            descriptor = _descriptor(default, spec, self._managed)
            return self._node.declare_parameter(name, default, descriptor).value
        except ParameterException as error:  # wrong type, or out of range
            is_type = isinstance(error, InvalidParameterTypeException)
            hint = ' (write 1.0, not 1)' if is_type and isinstance(default, float) else ''
            raise ConfigError(f'{name}: {error}{hint}') from None

    def _validate(self, changes: list[Parameter]) -> SetParametersResult:
        try:
            ours = self._ours(changes)
            new = replaced(self.options, ours)
            if self._check is not None:
                for name in self._read_only:
                    if name in ours:
                        raise ConfigError(f'{name}: {_READ_ONLY_IF_MANAGED}')
                self._check(new)
        except ConfigError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _apply(self, changes: list[Parameter]) -> None:
        self.options = replaced(self.options, self._ours(changes))

    def _ours(self, changes: list[Parameter]) -> dict[str, Any]:
        return {p.name: p.value for p in changes if p.name in self._names}


def _spec_of(field: dataclasses.Field[Any]) -> Spec:
    """Return the spec of a field; the options of the core have the same properties."""
    if 'spec' in field.metadata:
        spec: Spec = field.metadata['spec']
        return spec
    option = field.metadata['option']
    if field.default is None:
        return Spec(f'{option.description} 0: not given.', _NOT_GIVEN, option.high)
    return Spec(option.description, option.low, option.high)


def _rebuilt(options: Any, values: Mapping[str, Any], prefix: str) -> Any:
    """Construct the dataclass again, groups first, so that each validates itself."""
    changed = {}
    for field in dataclasses.fields(options):
        name, value = prefix + field.name, getattr(options, field.name)
        if dataclasses.is_dataclass(value):
            changed[field.name] = _rebuilt(value, values, f'{name}.')
        else:
            value = values.get(name, value)
            is_absent = field.default is None and value == _NOT_GIVEN
            changed[field.name] = None if is_absent else value
    try:
        return type(options)(**changed)
    except ValueError as error:  # from an options dataclass of the core
        raise ConfigError(f'{prefix}{error}') from None


def _descriptor(default: Any, spec: Spec, managed: bool) -> ParameterDescriptor:
    # rclpy itself rejects all changes of a parameter that is declared as read-only.
    is_read_only = spec.read_only and not managed
    descriptor = ParameterDescriptor(description=spec.description, read_only=is_read_only)
    if spec.read_only and managed:
        descriptor.additional_constraints = _READ_ONLY_IF_MANAGED
    elif spec.choices:
        descriptor.additional_constraints = 'one of ' + ', '.join(spec.choices)
    if spec.low is not None and spec.high is not None:
        if isinstance(default, int):
            steps = IntegerRange(from_value=int(spec.low), to_value=int(spec.high), step=1)
            descriptor.integer_range = [steps]
        else:
            span = FloatingPointRange(from_value=float(spec.low), to_value=float(spec.high))
            descriptor.floating_point_range = [span]
    return descriptor
