# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Where a camera's calibration lies on disk, as camera_info_manager names it."""

from __future__ import annotations

import os
from pathlib import Path
from urllib.parse import unquote

from p4pfr_ros.files.yaml_fields import ConfigError

_FILE = 'file://'


def calibration_path(calibration_file: str, camera_name: str) -> Path:
    """
    Return the file that the parameter ``calibration_file`` means.

    It is a path or a file:// URL, in which ``~``, ``${ROS_HOME}`` and ``${NAME}`` (the camera's)
    are filled in. Without one it is camera_info_manager's default.

    Raises
    ------
    ConfigError
        It is another kind of URL.

    """
    ros_home = os.environ.get('ROS_HOME') or str(Path.home() / '.ros')
    given = calibration_file or f'{ros_home}/camera_info/{camera_name}.yaml'
    path = unquote(given.removeprefix(_FILE)) if given.startswith(_FILE) else given
    if '://' in path:
        raise ConfigError(f'calibration_file: expected a path or a file:// URL, got {given!r}')
    filled = path.replace('${ROS_HOME}', ros_home).replace('${NAME}', camera_name)
    return Path(filled).expanduser()
