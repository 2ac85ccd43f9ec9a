# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Fields of options dataclasses: default, range and description are stated once, at the field.

The ROS parameters and the command line take all three from there.
"""

from __future__ import annotations

import dataclasses
from typing import Any


@dataclasses.dataclass(frozen=True, slots=True)
class Option:
    """
    The description and the range of a field of an options dataclass.

    description
        One or two sentences.
    low, high
        The range of its values, both ends included; None for a switch.
    """

    description: str
    low: float | None = None
    high: float | None = None


def option(default: Any, description: str, *, low: float, high: float) -> Any:
    """Make a field of an options dataclass; with a default of None it is optional."""
    return dataclasses.field(default=default, metadata={'option': Option(description, low, high)})


def switch(default: bool, description: str) -> Any:
    """Make a field of an options dataclass that is True or False."""
    return dataclasses.field(default=default, metadata={'option': Option(description)})


def option_of(options: Any, name: str) -> Option:
    """Return the description and the range of a field of an options dataclass."""
    [result] = (f.metadata['option'] for f in dataclasses.fields(options) if f.name == name)
    assert isinstance(result, Option)
    return result


def check_ranges(options: Any) -> None:
    """
    Check every field of an options dataclass against its range.

    Raises
    ------
    ValueError
        Names the first field out of its range, the range and the value.

    """
    for field in dataclasses.fields(options):
        value, limits = getattr(options, field.name), field.metadata['option']
        if isinstance(field.default, bool):
            if not isinstance(value, bool):
                raise ValueError(f'{field.name} must be True or False, got {value!r}')
        # Written so that NaN is out of range.
        elif value is not None and not limits.low <= value <= limits.high:
            raise ValueError(
                f'{field.name} must be from {limits.low:g} to {limits.high:g}, got {value}'
            )
