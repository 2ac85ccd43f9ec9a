# Copyright 2026 p4pfr_ros maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Where files will be written: wrong places show before anybody waits for what goes there."""

from __future__ import annotations

from pathlib import Path

from p4pfr_ros.files import ConfigError


def check_place(path: Path) -> None:
    """
    See that a file can be written there, before anybody waits for it.

    Raises
    ------
    ConfigError
        It cannot.

    """
    was_there = path.exists()
    try:
        with path.open('ab'):
            pass
    except OSError as error:
        raise ConfigError(f'{path}: expected a place to write to: {error.strerror}') from None
    if not was_there:
        path.unlink()
