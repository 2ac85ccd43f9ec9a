# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""Keeps the tests' DDS traffic on this machine, and apart from everyone else's."""

import os
import socket
import sys

import pytest

# 0 is where everyone is; above 101, DDS's ports would run into the system's own.
MOST_DOMAINS = 101
domain = int(os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % MOST_DOMAINS)))
# Processes that share the work (pytest -n) inherit that, and each needs one of its own.
worker = int(os.environ.get('PYTEST_XDIST_WORKER', 'gw0').removeprefix('gw'))
if worker > 0:
    os.environ['ROS_DOMAIN_ID'] = str(1 + (domain - 1 + worker) % MOST_DOMAINS)
os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'LOCALHOST'
# Where the ROS wheels keep ament's index; a sourced ROS has said so already.
os.environ.setdefault('AMENT_PREFIX_PATH', sys.prefix)


def pytest_sessionstart():
    """Say at once why no node would find another, instead of a timeout in each test."""
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.sendto(b'', ('127.0.0.1', 9))
    except OSError as error:
        reason = f'no connection to 127.0.0.1 ({error.strerror}), which DDS needs'
        pytest.exit(f'{reason}: ip link set lo up', returncode=1)
