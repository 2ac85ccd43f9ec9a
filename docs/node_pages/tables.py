# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Markdown tables of topics, services and parameters."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
import inspect
from itertools import groupby
from typing import Any

from p4pfr_ros.ros.parameters.declare import flattened, Spec

from .interfaces import Endpoint, Role

_TITLES = {
    Role.IN: 'Subscribed topics',
    Role.OUT: 'Published topics',
    Role.SERVICE: 'Services',
    Role.CLIENT: 'Service clients',
}
_TYPES = {bool: 'bool', int: 'integer', float: 'double', str: 'string'}

# Name, default and spec.
_Parameter = tuple[str, Any, Spec]


def interface(node: str, endpoints: Iterable[Endpoint], descriptions: Mapping[str, str]) -> str:
    """
    Return tables of topics and services, in the order of the descriptions.

    Raises
    ------
    ValueError
        An endpoint has no description, or a description has no endpoint.

    """
    by_name = {endpoint.name: endpoint for endpoint in endpoints}
    differing = sorted(by_name.keys() ^ descriptions.keys())
    if differing:
        raise ValueError(
            f'descriptions.py: {node} and its descriptions differ in {", ".join(differing)}'
        )
    return '\n\n'.join(_of_roles([by_name[name] for name in descriptions], descriptions))


def _of_roles(endpoints: list[Endpoint], descriptions: Mapping[str, str]) -> Iterator[str]:
    for role, title in _TITLES.items():
        of_role = [endpoint for endpoint in endpoints if endpoint.role is role]
        if not of_role:
            continue
        if role in (Role.IN, Role.OUT):
            rows = [[f'`{e.name}`', e.type, e.qos, descriptions[e.name]] for e in of_role]
            table = _table(('topic', 'type', 'QoS', 'description'), rows)
        else:
            rows = [[f'`{e.name}`', e.type, descriptions[e.name]] for e in of_role]
            table = _table(('service', 'type', 'description'), rows)
        yield f'### {title}\n\n{table}'


def parameters(options: Any) -> str:
    """Return a table of parameters for each group of an options dataclass."""
    own: list[_Parameter] = []
    groups: list[tuple[str, list[_Parameter]]] = []
    for group, members in groupby(flattened(options), lambda row: row[0].rpartition('.')[0]):
        if group:
            groups.append((group, list(members)))
        else:
            own.extend(members)
    parts = [_parameter_table(own)]
    for group, rows in groups:
        # The first paragraph: the docstrings of the core also list the fields.
        purpose = (inspect.getdoc(getattr(options, group)) or '').partition('\n\n')[0]
        purpose = purpose.replace('``', '`')
        parts.append(f'### `{group}.*`\n\n{purpose}\n\n{_parameter_table(rows)}')
    return '\n\n'.join(parts)


def _parameter_table(members: Iterable[_Parameter]) -> str:
    rows = [
        [
            f'`{name}`',
            _TYPES[type(value)],
            _code(value),
            allowed(value, spec).replace(', ', ',<br>'),
            'yes' if spec.read_only else '',
            spec.description,
        ]
        for name, value, spec in members
    ]
    return _table(('parameter', 'type', 'default', 'allowed', 'read-only', 'description'), rows)


def allowed(value: Any, spec: Spec) -> str:
    """Return the valid values of a parameter; empty if all values of its type are valid."""
    if spec.low is None or spec.high is None:
        return ', '.join(spec.choices)
    digits = 'd' if isinstance(value, int) else 'g'
    return f'{spec.low:{digits}} to {spec.high:{digits}}'


def _code(value: Any) -> str:
    return f'`{str(value).lower()}`' if isinstance(value, bool) else f'`{value!r}`'


def _table(head: tuple[str, ...], rows: list[list[str]]) -> str:
    """Return a table without empty columns."""
    columns = [column for column in range(len(head)) if any(row[column] for row in rows)]
    lines = [head, ['---'] * len(head), *rows]
    cells = ([line[column].replace('|', r'\|') for column in columns] for line in lines)
    return '\n'.join(f'| {" | ".join(line)} |' for line in cells)
