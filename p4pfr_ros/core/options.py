# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Fields of options dataclasses: default, range and description are stated once, at the field.

The ROS parameters and the command line take all three from there.
"""

from __future__ import annotations

import dataclasses
from numbers import Real
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


def check_options(options: Any) -> None:
    """
    Check every field of an options dataclass, and convert its numbers to float or int.

    The kernels are compiled once for each type of their arguments: an int for a float, or a
    float32, would compile them again.

    Raises
    ------
    ValueError
        Names the first field of another type or out of its range, what is expected and the value.

    """
    for field in dataclasses.fields(options):
        value = getattr(options, field.name)
        if value is not None or field.default is not None:
            object.__setattr__(options, field.name, _checked(field, value))


def _checked(field: dataclasses.Field[Any], value: Any) -> bool | int | float:
    limits, default = field.metadata['option'], field.default
    if isinstance(default, bool):
        if isinstance(value, bool):
            return value
        expected = 'True or False'
    elif not isinstance(value, Real) or isinstance(value, bool):
        expected = 'a number'
    elif not limits.low <= value <= limits.high:  # written so that NaN is out of range
        expected = f'from {limits.low:g} to {limits.high:g}'
    elif not isinstance(default, int):
        return float(value)
    elif float(value).is_integer():
        return int(float(value))
    else:
        expected = 'an integer'
    raise ValueError(f'{field.name} must be {expected}, got {value!r}')
