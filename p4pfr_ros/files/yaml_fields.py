# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Checked values of a mapping from a YAML file: type, range and unit; errors name the key."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import dataclass
import difflib
import math
from typing import Any

from p4pfr_ros.files.printable import printable, shown

_MAX_KEY, _MAX_MESSAGE = 40, 1000
_PER_METRE = {'m': 1.0, 'mm': 1000.0}


class ConfigError(Exception):
    """A user's file, option or parameter is wrong. One line: where, expected, got."""

    def __init__(self, message: str) -> None:
        super().__init__(printable(message, _MAX_MESSAGE))


@dataclass(frozen=True, slots=True)
class Fields:
    """
    The keys and values of one YAML mapping.

    Each method raises ``ValueError('KEY: expected ..., got ...')`` for a wrong value, where KEY
    is the full dotted path of the key.

    Parameters
    ----------
    values
        The mapping.
    path
        Dotted path of the mapping in the file; empty for the whole file.

    """

    values: dict[Any, Any]
    path: str = ''

    @classmethod
    def of(cls, value: object, path: str = '', expected: str = 'keys and values') -> Fields:
        """Wrap a value, which must be a mapping."""
        if not isinstance(value, dict):
            where = f'{path}: ' if path else ''
            raise ValueError(f'{where}expected {expected}, got {shown(value)}')
        return cls(value, path)

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def path_of(self, key: object) -> str:
        """Return the dotted path of a key."""
        name = printable(str(key), _MAX_KEY)
        return f'{self.path}.{name}' if self.path else name

    def error(self, key: object, expected: str, hint: str = '') -> ValueError:
        """Make the error for a key whose value is wrong or missing."""
        got = shown(self.values[key]) if key in self.values else 'none'
        return ValueError(f'{self.path_of(key)}: expected {expected}, got {got}{hint}')

    def reject_unknown(self, known: Collection[str], aliases: Collection[str] = ()) -> None:
        """Reject keys that are neither known nor aliases; suggest the closest known key."""
        for key in self.values:
            if key not in known and key not in aliases:
                raise ValueError(
                    f'{self.path_of(key)}: unknown key, expected one of {", ".join(known)}'
                    + _suggestion(key, known)
                )

    def section(self, key: str, expected: str = 'keys and values') -> Fields:
        """Return the mapping under a key."""
        return Fields.of(self.values.get(key), self.path_of(key), expected)

    def sections(self, key: str, each: str, expected: str) -> list[Fields]:
        """Return the list of mappings under a key; ``each`` describes an expected mapping."""
        items = self.values.get(key)
        if not isinstance(items, list):
            raise self.error(key, expected)
        return [Fields.of(v, f'{self.path_of(key)}[{n}]', each) for n, v in enumerate(items)]

    def choice(self, key: str, known: Collection[str], default: str | None = None) -> str:
        """Return one of the known words; without a default, the key is required."""
        value = self.values.get(key, default)
        if not isinstance(value, str) or value not in known:
            hint = _suggestion(value, known)
            raise self.error(key, f'one of {", ".join(known)}', hint)
        return value

    def count(self, key: str) -> int:
        """Return an integer > 0."""
        value = self.values.get(key)
        if not isinstance(value, int) or isinstance(value, bool) or value < 1:
            raise self.error(key, 'an integer > 0')
        return value

    def number(self, key: str, low: float = -math.inf) -> float:
        """Return a finite number ≥ low."""
        value = _number(self.values.get(key))
        if value is None or value < low:
            at_least = '' if low == -math.inf else f' ≥ {low:g}'
            raise self.error(key, f'a finite number{at_least}')
        return value

    def numbers(self, key: str, n: int | None = None) -> tuple[float, ...]:
        """Return a list of n finite numbers (None: any length)."""
        value = self.values.get(key)
        numbers = [_number(v) for v in value] if isinstance(value, list) else [None]
        if None in numbers or n not in (None, len(numbers)):
            raise self.error(key, f'a list of {"" if n is None else f"{n} "}finite numbers')
        return tuple(v for v in numbers if v is not None)

    def length_m(self, name: str, *, is_coordinate: bool = False) -> float | None:
        """
        Return a length in metres, given as ``name_m`` or ``name_mm``; None if it is missing.

        A coordinate may have any sign or be zero; any other length must be > 0.
        """
        if name in self.values:
            raise ValueError(
                f'{self.path_of(name)}: expected a unit: {name}_m or {name}_mm, got {name}'
            )
        units = [unit for unit in _PER_METRE if f'{name}_{unit}' in self.values]
        if not units:
            return None
        key = f'{name}_{units[-1]}'
        if len(units) > 1:
            raise ValueError(
                f'{self.path_of(key)}: expected one of {name}_m and {name}_mm, got both'
            )
        value = _number(self.values[key])
        if value is None or not (is_coordinate or value > 0.0):
            what = 'a finite coordinate' if is_coordinate else 'a length > 0'
            raise self.error(key, f'{what} in {units[0]}')
        return value / _PER_METRE[units[0]]


def length_keys(names: Iterable[str]) -> set[str]:
    """Return the keys that `Fields.length_m` handles, with and without a unit."""
    return {f'{name}{unit}' for name in names for unit in ('', *(f'_{u}' for u in _PER_METRE))}


def _number(value: object) -> float | None:
    """Return a finite float, or None if the value is not a number."""
    # A string may be a number: PyYAML reads YAML 1.1, where the 1e-05 of ROS's yaml-cpp is none.
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        return None
    try:
        number = float(value)
    except (ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None


def _suggestion(word: object, known: Collection[str]) -> str:
    near = difflib.get_close_matches(str(word), known, n=1)
    return f' (did you mean {near[0]}?)' if near else ''
