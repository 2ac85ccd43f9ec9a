# SPDX-License-Identifier: Apache-2.0
"""Keeps the tests' DDS traffic on this machine, and apart from everyone else's."""

import os
import sys

# 0 is where everyone is; above 101, DDS's ports would run into the system's own.
os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 101))
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
# Where the ROS wheels keep ament's index; a sourced ROS has said so already.
os.environ.setdefault('AMENT_PREFIX_PATH', sys.prefix)
