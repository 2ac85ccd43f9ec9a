# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``p4pfr demo``: a simulated camera, a detector and a pose node, three processes over DDS."""

from __future__ import annotations

import argparse

from p4pfr_ros.files.yaml_fields import ConfigError


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Describe the command to argparse."""
    parser = commands.add_parser(
        'demo', help='watch a simulated camera, detector and pose node (needs ROS)'
    )
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the demo."""
    try:
        from p4pfr_ros.ros.demo import main
    except ModuleNotFoundError as error:
        if str(error.name).startswith('p4pfr_ros'):
            raise
        raise ConfigError(
            f'the demo needs ROS 2 ({error.name} is missing): '
            "source a ROS, or pip install 'p4pfr_ros[ros]'"
        ) from None
    return main()
