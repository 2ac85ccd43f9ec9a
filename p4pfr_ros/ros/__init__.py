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

"""The nodes: they convert, call and publish."""

import os
from pathlib import Path
import sys

# A sourced ROS workspace names its folders in AMENT_PREFIX_PATH. With ROS from Python wheels
# nothing is sourced: rclpy runs all the same, but the ament index, where packages find their
# shared files, is looked up there only. Processes that are started from here inherit it.
if not os.environ.get('AMENT_PREFIX_PATH') and Path(sys.prefix, 'share/ament_index').is_dir():
    os.environ['AMENT_PREFIX_PATH'] = sys.prefix
