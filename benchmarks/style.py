# SPDX-License-Identifier: Apache-2.0
"""How all our figures look."""

from __future__ import annotations

from typing import Any

STYLE: Any = {
    'font.size': 9,
    'axes.spines.top': False,
    'axes.spines.right': False,
    'axes.titlesize': 10,
    'axes.titlelocation': 'left',
    'legend.frameon': False,
    'legend.fontsize': 8,
}
