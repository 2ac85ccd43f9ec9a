# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The nodes: they convert, call and publish."""

import os
from pathlib import Path
import sys

# A sourced ROS workspace names its folders in AMENT_PREFIX_PATH. With ROS from Python wheels
# nothing is sourced: rclpy runs all the same, but the ament index, where packages find their
# shared files, is looked up there only. Processes that are started from here inherit it.
if not os.environ.get('AMENT_PREFIX_PATH') and Path(sys.prefix, 'share/ament_index').is_dir():
    os.environ['AMENT_PREFIX_PATH'] = sys.prefix
