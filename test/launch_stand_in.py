# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Replaces ``launch`` and ``launch_ros``, which only a ROS installation has.

It implements the classes that our launch files use, with their names and keywords, and lists the
nodes instead of starting them.
"""

from __future__ import annotations

from dataclasses import dataclass, field
import runpy
import sys
from types import ModuleType
from typing import Any
from unittest import mock

SHARE = '/share'


def perform(value, configurations):
    """Evaluate a substitution, or a list of them, to text."""
    if isinstance(value, (list, tuple)):
        return ''.join(perform(part, configurations) for part in value)
    return value.perform(configurations) if hasattr(value, 'perform') else value


@dataclass
class LaunchConfiguration:
    """The value of an argument."""

    name: str

    def perform(self, configurations):
        """Return the text."""
        return configurations[self.name]


@dataclass
class PathJoinSubstitution:
    """A path of several parts."""

    parts: list[Any]

    def perform(self, configurations):
        """Return the text."""
        return '/'.join(perform(part, configurations) for part in self.parts)


@dataclass
class FindPackageShare:
    """The share folder of a package."""

    package: str

    def perform(self, _):
        """Return the text."""
        return f'{SHARE}/{self.package}'


@dataclass
class ParameterValue:
    """A parameter with an explicit type."""

    value: Any
    value_type: type = field(kw_only=True)

    def perform(self, configurations):
        """Return the value with its type."""
        text = perform(self.value, configurations)
        return {'true': True, 'false': False}[text] if self.value_type is bool else text


@dataclass
class PythonLaunchDescriptionSource:
    """The path of another launch file."""

    location: Any


@dataclass
class IfCondition:
    """A condition of an action."""

    expression: Any

    def evaluate(self, configurations):
        """Return whether it holds."""
        return {'true': True, 'false': False}[perform(self.expression, configurations)]


@dataclass
class DeclareLaunchArgument:
    """An argument; without a default it must be given."""

    name: str
    default_value: Any = field(default=None, kw_only=True)
    description: str = field(kw_only=True)

    def visit(self, run):
        """Execute the action."""
        run.declared.add(self.name)
        if self.name not in run.configurations:
            assert self.default_value is not None, f'{self.name} is missing'
            run.configurations[self.name] = perform(self.default_value, run.configurations)


@dataclass
class OpaqueFunction:
    """Actions that depend on the values of arguments."""

    function: Any = field(kw_only=True)

    def visit(self, run):
        """Execute the action."""
        run.visit_all(self.function(run.configurations))


@dataclass
class IncludeLaunchDescription:
    """Another launch file; its arguments are added to ours."""

    source: PythonLaunchDescriptionSource
    launch_arguments: Any = field(default=(), kw_only=True)

    def visit(self, run):
        """Execute the action."""
        for name, value in self.launch_arguments:
            run.configurations[name] = perform(value, run.configurations)
        run.include(perform(self.source.location, run.configurations))


@dataclass
class GroupAction:
    """Actions with their own scope of arguments."""

    actions: list[Any]

    def visit(self, run):
        """Execute the action."""
        before = dict(run.configurations)
        run.visit_all(self.actions)
        run.configurations.clear()
        run.configurations.update(before)


@dataclass(kw_only=True)
class Node:
    """The process of a node."""

    package: str
    executable: str
    name: str | None = None
    namespace: Any = ''
    parameters: list[Any] = field(default_factory=list)
    remappings: list[Any] = field(default_factory=list)
    arguments: list[Any] = field(default_factory=list)
    condition: IfCondition | None = None

    def visit(self, run):
        """Execute the action."""
        now = run.configurations
        if self.condition is not None and not self.condition.evaluate(now):
            return
        files = [p for p in self.parameters if isinstance(p, str)]
        given = {k: v for p in self.parameters if isinstance(p, dict) for k, v in p.items()}
        run.nodes.append(
            Node(
                package=self.package,
                executable=self.executable,
                name=self.name,
                namespace=perform(self.namespace, now),
                parameters=[*files, {k: perform(v, now) for k, v in given.items()}],
                remappings=[(a, perform(b, now)) for a, b in self.remappings],
                arguments=[perform(argument, now) for argument in self.arguments],
            )
        )


@dataclass
class LaunchDescription:
    """The actions of a launch file."""

    entities: list[Any]


_MODULES = {
    'launch': (LaunchDescription,),
    'launch.actions': (
        DeclareLaunchArgument,
        GroupAction,
        IncludeLaunchDescription,
        OpaqueFunction,
    ),
    'launch.conditions': (IfCondition,),
    'launch.launch_description_sources': (PythonLaunchDescriptionSource,),
    'launch.substitutions': (LaunchConfiguration, PathJoinSubstitution),
    'launch_ros': (),
    'launch_ros.actions': (Node,),
    'launch_ros.parameter_descriptions': (ParameterValue,),
    'launch_ros.substitutions': (FindPackageShare,),
}


class Run:
    """Executes a launch file with some arguments; lists ``nodes`` in order."""

    def __init__(self, path, root, **arguments):
        self.nodes = []
        self.declared = set()
        self.configurations = dict(arguments)
        self._root = root
        self._read(path)
        unknown = set(arguments) - self.declared
        assert not unknown, f'not declared: {unknown}'

    def include(self, location):
        """Execute a launch file of our package."""
        self._read(self._root / location.removeprefix(f'{SHARE}/p4pfr_ros/'))

    def visit_all(self, entities):
        """Execute actions in order."""
        for entity in entities:
            entity.visit(self)

    def _read(self, path):
        with mock.patch.dict(sys.modules, _modules()):
            described = runpy.run_path(str(path))['generate_launch_description']()
        self.visit_all(described.entities)


def _modules():
    modules = {name: ModuleType(name) for name in _MODULES}
    for name, things in _MODULES.items():
        for thing in things:
            setattr(modules[name], thing.__name__, thing)
    return modules
