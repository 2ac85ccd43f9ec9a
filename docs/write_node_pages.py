# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Write the tables on the nodes' pages anew, from the nodes themselves.

    python docs/write_node_pages.py [--check]

What stands between ``<!-- made: NAME -->`` and ``<!-- end of NAME -->`` is made here, and all else
on a page is written by hand and kept.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
import os
from pathlib import Path
import re

DOCS = Path(__file__).parent

_PART = re.compile(r'<!-- made: (\w+) -->\n.*?<!-- end of \1 -->', re.DOTALL)


def main() -> None:
    """Write the pages; with --check, fail where one is not as it would be written."""
    parser = argparse.ArgumentParser(description=__doc__.strip().split('\n\n')[0])
    parser.add_argument('--check', action='store_true', help='write nothing, compare')
    check = parser.parse_args().check
    stale = {path: text for path, text in _written().items() if path.read_text() != text}
    if check and stale:
        names = ', '.join(path.name for path in stale)
        raise SystemExit(
            f'not in step with the code: {names}; python docs/write_node_pages.py writes anew'
        )
    for path, text in stale.items():
        path.write_text(text)


def filled(text: str, parts: Mapping[str, str]) -> str:
    """
    Return a page with its made parts replaced.

    Raises
    ------
    ValueError
        The page has not each of the parts exactly once.

    """
    names = [match[1] for match in _PART.finditer(text)]
    if sorted(names) != sorted(parts):
        raise ValueError(f'expected the parts {", ".join(parts)}, got {", ".join(names)}')
    return _PART.sub(
        lambda part: f'<!-- made: {part[1]} -->\n\n{parts[part[1]]}\n\n<!-- end of {part[1]} -->',
        text,
    )


def _written() -> dict[Path, str]:
    """Return each page as it should be."""
    # Nothing is computed here that would be worth compiling; to be said before Numba is loaded.
    os.environ['NUMBA_DISABLE_JIT'] = '1'
    from node_pages import PAGES

    paths = {DOCS / name: parts for name, parts in PAGES.items()}
    return {path: filled(path.read_text(), parts()) for path, parts in paths.items()}


if __name__ == '__main__':
    main()
