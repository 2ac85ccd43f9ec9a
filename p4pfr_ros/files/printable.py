# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Text from files and messages as part of a log line: cut, with control characters escaped.

What others wrote may be of any length, and may hold line breaks and codes that move the cursor of
a terminal.
"""

from __future__ import annotations

import os
import reprlib

_MAX_LINE, _MAX_PATH, _MAX_VALUE = 300, 100, 40


def printable(text: str, limit: int = _MAX_LINE) -> str:
    """Return a text in one line of at most ``limit`` characters, control characters escaped."""
    if len(text) <= limit and text.isprintable():
        return text
    # Escaping lengthens, so the beginning is enough.
    escaped = ''.join(map(_escaped, text[: limit + 1]))
    return escaped if len(escaped) <= limit else f'{escaped[: limit - 3]}...'


def printable_path(path: str | os.PathLike[str]) -> str:
    """Return a path in one line; of a long path the end, which has the name of the file."""
    escaped = ''.join(map(_escaped, os.fspath(path)[-_MAX_PATH - 1 :]))
    return escaped if len(escaped) <= _MAX_PATH else f'...{escaped[3 - _MAX_PATH :]}'


def shown(value: object) -> str:
    """Return a value as in Python, for 'got ...': cut, and of nested values the outermost."""
    if value is None:
        return 'nothing'
    text = repr(value[: _MAX_VALUE + 1]) if isinstance(value, str) else _BRIEF.repr(value)
    return text if len(text) <= _MAX_VALUE else f'{text[:_MAX_VALUE]}...'


def _escaped(character: str) -> str:
    return character if character.isprintable() else repr(character)[1:-1]


_BRIEF = reprlib.Repr()
# Without a limit of levels, a value of a few aliases in YAML could have a billion entries.
_BRIEF.maxlevel = 3
