# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Tables in Markdown: topics, services, parameters."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from itertools import groupby
from typing import Any

from p4pfr_ros.ros.parameters.declare import flattened, Spec

from .interfaces import Endpoint, Role

_TITLES = {
    Role.IN: 'In',
    Role.OUT: 'Out',
    Role.SERVICE: 'Services',
    Role.CLIENT: 'A service that it calls',
}
_TYPES = {bool: 'bool', int: 'integer', float: 'double', str: 'string'}

# Name, value and what is known of it.
_Parameter = tuple[str, Any, Spec]


def interface(node: str, endpoints: Iterable[Endpoint], words: Mapping[str, str]) -> str:
    """
    Write tables of topics and services, in the order of the words.

    Raises
    ------
    ValueError
        There are no words for an endpoint, or words for none.

    """
    by_name = {endpoint.name: endpoint for endpoint in endpoints}
    unlike = sorted(by_name.keys() ^ words.keys())
    if unlike:
        raise ValueError(f'words.py: {node} and its words differ in {", ".join(unlike)}')
    return '\n\n'.join(_of_roles([by_name[name] for name in words], words))


def _of_roles(endpoints: list[Endpoint], words: Mapping[str, str]) -> Iterator[str]:
    for role, title in _TITLES.items():
        of_role = [endpoint for endpoint in endpoints if endpoint.role is role]
        if not of_role:
            continue
        if role in (Role.IN, Role.OUT):
            rows = [[f'`{e.name}`', e.type, e.qos, words[e.name]] for e in of_role]
            table = _table(('topic', 'type', 'QoS', 'what'), rows)
        else:
            rows = [[f'`{e.name}`', e.type, words[e.name]] for e in of_role]
            table = _table(('service', 'type', 'what'), rows)
        yield f'### {title}\n\n{table}'


def parameters(options: Any) -> str:
    """Write the parameters of an options dataclass, a table for each group."""
    own: list[_Parameter] = []
    groups: list[tuple[str, list[_Parameter]]] = []
    for group, members in groupby(flattened(options), lambda row: row[0].rpartition('.')[0]):
        if group:
            groups.append((group, list(members)))
        else:
            own.extend(members)
    parts = [_parameter_table(own)]
    for group, rows in groups:
        purpose = (getattr(options, group).__doc__ or '').replace('``', '`')
        parts.append(f'### `{group}.*`\n\n{purpose}\n\n{_parameter_table(rows)}')
    return '\n\n'.join(parts)


def _parameter_table(members: Iterable[_Parameter]) -> str:
    rows = [
        [
            f'`{name}`',
            _TYPES[type(value)],
            _written(value),
            allowed(value, spec).replace(', ', ',<br>'),
            'yes' if spec.read_only else '',
            spec.description,
        ]
        for name, value, spec in members
    ]
    return _table(('parameter', 'type', 'default', 'allowed', 'read-only', 'what'), rows)


def allowed(value: Any, spec: Spec) -> str:
    """Say which values a parameter may have, where not all of its type."""
    if spec.low is None or spec.high is None:
        return ', '.join(spec.choices)
    digits = 'd' if isinstance(value, int) else 'g'
    return f'{spec.low:{digits}} to {spec.high:{digits}}'


def _written(value: Any) -> str:
    return f'`{str(value).lower()}`' if isinstance(value, bool) else f'`{value!r}`'


def _table(head: tuple[str, ...], rows: list[list[str]]) -> str:
    """Write a table without the columns that would be empty."""
    kept = [place for place in range(len(head)) if any(row[place] for row in rows)]
    lines = [head, ['---'] * len(head), *rows]
    cells = ([line[place].replace('|', r'\|') for place in kept] for line in lines)
    return '\n'.join(f'| {" | ".join(line)} |' for line in cells)
