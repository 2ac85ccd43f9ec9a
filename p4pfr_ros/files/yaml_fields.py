# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The keys of a calibration file: each value as what it should be, or words for what it is."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import Any

_LONGEST = 40


@dataclass(frozen=True, slots=True)
class Fields:
    """
    The values below a key of a YAML file.

    Each method raises ``ValueError`` where the value is another one than it is asked for: with
    the whole path of the key, what was expected and what came.
    """

    given: dict[Any, Any]
    prefix: str = ''

    @classmethod
    def of(cls, tree: object, prefix: str = '') -> Fields:
        """Take what a file or a key holds."""
        if not isinstance(tree, dict):
            where = f'{prefix[:-1]}: ' if prefix else ''
            raise ValueError(f'{where}expected keys and values, got {_shown(tree)}')
        return cls(tree, prefix)

    def __contains__(self, key: str) -> bool:
        return key in self.given

    def below(self, key: str) -> Fields:
        """Take the keys below a key."""
        return Fields.of(self.given.get(key), f'{self.prefix}{key}.')

    def word(self, key: str, default: str) -> str:
        """Take a word, or a whole number as one; the default where there is none."""
        value = self.given.get(key, default)
        if isinstance(value, int) and not isinstance(value, bool):
            value = str(value)
        if not isinstance(value, str) or not value:
            raise self._wrong(key, 'a word')
        return value

    def count(self, key: str) -> int:
        """Take a whole number above 0."""
        value = self.given.get(key)
        if not isinstance(value, int) or isinstance(value, bool) or value < 1:
            raise self._wrong(key, 'a whole number > 0')
        return value

    def number(self, key: str, low: float = -math.inf) -> float:
        """Take a finite number that is not below another."""
        value = _number(self.given.get(key))
        if value is None or value < low:
            at_least = '' if low == -math.inf else f' ≥ {low}'
            raise self._wrong(key, f'a finite number{at_least}')
        return value

    def numbers(self, key: str, n: int | None = None) -> tuple[float, ...]:
        """Take a list of n finite numbers (None: of any length)."""
        value = self.given.get(key)
        values = [_number(v) for v in value] if isinstance(value, list) else [None]
        if None in values or n not in (None, len(values)):
            raise self._wrong(key, f'a list of {"" if n is None else f"{n} "}finite numbers')
        return tuple(v for v in values if v is not None)

    def matrix(self, key: str, rows: int, cols: int | None) -> tuple[float, ...]:
        """Take the data of a matrix, row by row, that says its own size (cols None: any)."""
        at = self.below(key)
        size = {'rows': rows, 'cols': cols}
        for name, wanted in size.items():
            if wanted is not None and at.given.get(name) != wanted:
                raise at._wrong(name, str(wanted))
        if cols is None:
            data = at.numbers('data')
            if at.given.get('cols') != len(data):
                raise at._wrong('cols', f'{len(data)}, as data has')
            return data
        return at.numbers('data', rows * cols)

    def _wrong(self, key: str, expected: str) -> ValueError:
        got = _shown(self.given[key]) if key in self.given else 'none'
        return ValueError(f'{self.prefix}{key}: expected {expected}, got {got}')


def _number(value: object) -> float | None:
    if isinstance(value, str):
        # YAML 1.2 writes 1e-05 for a number, as ROS does; to YAML 1.1, as read here, it is a word.
        try:
            value = float(value)
        except ValueError:
            return None
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return None
    return float(value) if math.isfinite(value) else None


def _shown(value: object) -> str:
    """Say in a line what a value is."""
    if value is None:
        return 'nothing'
    text = repr(value)
    return text if len(text) <= _LONGEST else f'{text[:_LONGEST]}...'
