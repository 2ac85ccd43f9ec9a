# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Generate the tables on the pages of the nodes from the nodes themselves.

    python docs/write_node_pages.py [--check]

Only the text between ``<!-- generated: NAME -->`` and ``<!-- end: NAME -->`` is replaced.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
import os
from pathlib import Path
import re

DOCS = Path(__file__).parent

_PART = re.compile(r'<!-- generated: (\w+) -->\n.*?<!-- end: \1 -->', re.DOTALL)


def main() -> None:
    """Write the pages; with --check, fail if a page is not up to date."""
    parser = argparse.ArgumentParser(description=__doc__.strip().split('\n\n')[0])
    parser.add_argument('--check', action='store_true', help='only compare, write nothing')
    check = parser.parse_args().check
    stale = {path: text for path, text in _generated().items() if path.read_text() != text}
    if check and stale:
        names = ', '.join(path.name for path in stale)
        raise SystemExit(f'not up to date: {names}; run python docs/write_node_pages.py')
    for path, text in stale.items():
        path.write_text(text)


def filled(text: str, parts: Mapping[str, str]) -> str:
    """
    Return a page with its generated parts replaced.

    Raises
    ------
    ValueError
        The page does not have each of the parts exactly once.

    """
    names = [match[1] for match in _PART.finditer(text)]
    if sorted(names) != sorted(parts):
        raise ValueError(f'expected the parts {", ".join(parts)}, got {", ".join(names)}')
    return _PART.sub(
        lambda part: (
            f'<!-- generated: {part[1]} -->\n\n{parts[part[1]]}\n\n<!-- end: {part[1]} -->'
        ),
        text,
    )


def _generated() -> dict[Path, str]:
    """Return each page with its current tables."""
    # Nothing here is worth compiling; must be set before Numba is imported.
    os.environ['NUMBA_DISABLE_JIT'] = '1'
    from node_pages import PAGES

    paths = {DOCS / name: parts for name, parts in PAGES.items()}
    return {path: filled(path.read_text(), parts()) for path, parts in paths.items()}


if __name__ == '__main__':
    main()
