# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``p4pfr demo``: simulated camera and nodes."""

from __future__ import annotations

import argparse

from p4pfr_ros.files.dependencies import how_to_get_ros, require
from p4pfr_ros.files.yaml_fields import ConfigError


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the parser."""
    text = 'run a simulated camera, the detector and the pose node (requires ROS 2)'
    parser = commands.add_parser('demo', help=text, description=f'{text[0].upper()}{text[1:]}.')
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Run the demo."""
    require('rich')
    try:
        from p4pfr_ros.ros.demo import main
    except ModuleNotFoundError as error:
        if str(error.name).startswith('p4pfr_ros'):
            raise
        raise ConfigError(
            f'the demo requires ROS 2 ({error.name} is missing): {how_to_get_ros()}'
        ) from None
    return main()
