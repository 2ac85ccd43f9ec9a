# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
Optional dependencies: whether they are installed, and the command that installs a missing one.

The command depends on how this package was installed: by pip from an index, a clone or a folder,
or by colcon, where the extras of pip do not exist.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from importlib import metadata
from importlib.util import find_spec
import json
import os
from pathlib import Path
import shlex
import shutil
import sys
import sysconfig
from urllib.parse import unquote, urlparse

from p4pfr_ros.files.yaml_fields import ConfigError

_PACKAGE = 'p4pfr_ros'


@dataclass(frozen=True, slots=True)
class Extra:
    """
    An optional dependency.

    Parameters
    ----------
    name
        The extra of pip that installs it.
    features
        What needs it, in the plural.
    pip
        Its requirement on PyPI.
    apt
        Its package in Debian and Ubuntu; '' if there is none.

    """

    name: str
    features: str
    pip: str
    apt: str


# By module.
EXTRAS = {
    'aiohttp': Extra('live', 'web pages', "'aiohttp>=3.9'", 'python3-aiohttp'),
    'distributed': Extra(
        'distributed', 'batches of recordings', 'distributed', 'python3-distributed'
    ),
    'matplotlib': Extra('plot', 'plots and printed boards', 'matplotlib', 'python3-matplotlib'),
    'rich': Extra('cli', 'tables', 'rich', 'python3-rich'),
    'rosbags': Extra('bags', 'bags', "'rosbags>=0.11'", ''),
}


def is_installed(module: str) -> bool:
    """Return whether an optional dependency is installed, without importing it."""
    try:
        return find_spec(module) is not None
    except ValueError:  # it is blocked by an entry None in sys.modules
        return False


def require(module: str) -> None:
    """
    Check that an optional dependency is installed.

    Raises
    ------
    ConfigError
        It is not; names the command that installs it.

    """
    if not is_installed(module):
        extra = EXTRAS[module]
        raise ConfigError(f'{extra.features} need {module}: {install_command(extra)}')


def install_command(extra: Extra) -> str:
    """Return the command that installs an optional dependency here."""
    requirement = _requirement(extra.name)
    if requirement:
        return f'{_pip()} {requirement}'
    if extra.apt and not _is_virtual() and shutil.which('apt-get'):
        return f'sudo apt install {extra.apt}'
    return f'{_pip()} {extra.pip}'


def how_to_get_ros() -> str:
    """Return what makes ROS 2 available: its installation or, if this came by pip, its wheels."""
    requirement = _requirement('ros')
    wheels = f', or {_pip()} {requirement}' if requirement else ''
    return f'source a ROS 2 installation{wheels}'


def _requirement(extra: str) -> str:
    """
    Return how pip names this package with an extra, as arguments of ``pip install``.

    '' if pip did not install it (colcon, PYTHONPATH), or if what it was installed from is gone.
    """
    distribution = next(_installed(), None)
    if distribution is None:
        return ''
    text = distribution.read_text('direct_url.json')
    if text is None:
        by_pip = (distribution.read_text('INSTALLER') or '').strip() in ('pip', 'uv')
        return f"'{_PACKAGE}[{extra}]'" if by_pip else ''
    origin = json.loads(text)
    url = str(origin.get('url', ''))
    if 'vcs_info' in origin:
        return f"'{_PACKAGE}[{extra}] @ {origin['vcs_info']['vcs']}+{url}'"
    folder = Path(unquote(urlparse(url).path))
    if not url.startswith('file:') or not folder.exists():
        return ''
    options = '-e ' if origin.get('dir_info', {}).get('editable') else ''
    return options + shlex.quote(f'{folder}[{extra}]')


def _installed() -> Iterator[metadata.Distribution]:
    """Yield this package as it was installed, not what builds left in its sources."""
    for distribution in metadata.distributions(name=_PACKAGE):
        if not Path(str(distribution.locate_file('setup.py'))).exists():
            yield distribution


def _pip() -> str:
    """Return the command with which pip installs for this Python."""
    found = shutil.which('pip')
    is_ours = found is not None and Path(found).parent == Path(sys.executable).parent
    pip = 'pip' if is_ours else f'{shlex.quote(sys.executable)} -m pip'
    # The system's Python refuses otherwise (PEP 668).
    managed = Path(sysconfig.get_path('stdlib')) / 'EXTERNALLY-MANAGED'
    if managed.exists() and not _is_virtual():
        return f'{pip} install --break-system-packages'
    return f'{pip} install'


def _is_virtual() -> bool:
    return sys.prefix != sys.base_prefix or 'CONDA_PREFIX' in os.environ
