# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The code blocks of the README and of the pages in docs/.

A block that cannot be run here has a comment above it that says why:

    <!-- not run: needs a webcam -->
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
import re
import textwrap

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(
    path
    for path in (*ROOT.glob('*.md'), *ROOT.glob('examples/*.md'), *ROOT.glob('docs/**/*.md'))
    if not path.is_relative_to(ROOT / 'docs' / 'project')
)
# Drawings, formulas and output.
NO_CODE = {'', 'text', 'math'}
_BLOCK = re.compile(
    r'(?:^[ ]*<!-- not run: (?P<reason>[^\n]+?) -->\n+)?'
    r'^(?P<indent>[ ]*)```(?P<language>\w*)\n(?P<text>.*?)^(?P=indent)```$',
    re.MULTILINE | re.DOTALL,
)


@dataclass(frozen=True)
class Block:
    """A fenced block: the line of its fence, and why it is not run (empty: it is)."""

    path: Path
    line: int
    language: str
    text: str
    reason: str

    @property
    def place(self) -> str:
        """Where it is, as editors understand it."""
        return f'{self.path}:{self.line}'

    @property
    def file_name(self) -> str:
        """The name of the file that the block shows, from a comment in its first line."""
        match = re.match(r'# ([\w/]+\.\w+)\n', self.text)
        return match[1] if match else ''


def blocks_of(path: Path) -> list[Block]:
    """Return the blocks of a page that show code, in order."""
    text = path.read_text(encoding='utf-8')
    found = [
        Block(
            path,
            text.count('\n', 0, match.start('language')) + 1,
            match['language'],
            textwrap.dedent(match['text']),
            match['reason'] or '',
        )
        for match in _BLOCK.finditer(text)
    ]
    assert 2 * len(found) == len(re.findall(r'^ *```', text, re.MULTILINE)), path
    return [block for block in found if block.language not in NO_CODE]
