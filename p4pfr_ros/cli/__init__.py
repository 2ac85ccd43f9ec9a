# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""The command ``p4pfr``, one module per subcommand. Only ``p4pfr demo`` imports ROS."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import os
import sys

from p4pfr_ros import __version__
from p4pfr_ros.cli import board, calibrate, compile_kernels, demo, estimate
from p4pfr_ros.files.yaml_fields import ConfigError

# As shells report programs ended by SIGINT or SIGPIPE: 128 + the signal's number.
_INTERRUPTED, _PIPE_CLOSED = 130, 141


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit status: 0 on success, 1 on failure."""
    options = _parser().parse_args(arguments)
    try:
        status: int = options.run(options)
        sys.stdout.flush()  # raises BrokenPipeError here rather than at exit
    except ConfigError as error:
        print(f'p4pfr: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return _INTERRUPTED
    except BrokenPipeError:
        # The interpreter flushes stdout again at exit, which must not fail.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return _PIPE_CLOSED
    return status


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='p4pfr',
        description='Pose, focal length and lens distortion from images of a flat marker or '
        'board, with an uncalibrated camera.',
        epilog='Run p4pfr COMMAND --help for the options of a command.',
    )
    version = f'p4pfr_ros {__version__}'
    parser.add_argument('--version', action='version', version=version)
    commands = parser.add_subparsers(title='commands', metavar='COMMAND', required=True)
    for command in (estimate, calibrate, board, compile_kernels, demo):
        command.add_parser(commands)
    return parser
