# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""
The ROS 2 nodes; each converts a message, calls the ROS-free package and publishes the result.

Imports go downward only: nodes -> pose, demo -> parameters -> conversions -> runtime.
"""

import os
from pathlib import Path
import sys

# A sourced ROS workspace lists its prefixes in AMENT_PREFIX_PATH. With ROS from Python wheels
# nothing is sourced; rclpy works, but the ament index, which finds shared files of packages, uses
# that variable only. Child processes inherit it.
if not os.environ.get('AMENT_PREFIX_PATH') and Path(sys.prefix, 'share/ament_index').is_dir():
    os.environ['AMENT_PREFIX_PATH'] = sys.prefix
