# Copyright 2026 p4pfr_ros maintainers
# SPDX-License-Identifier: Apache-2.0

"""``p4pfr live``: calibrate a camera in front of a web page."""

from __future__ import annotations

import argparse
from pathlib import Path
import signal
import sys
import time
from typing import Any

from p4pfr_ros import EstimateOptions
from p4pfr_ros.cli.arguments import add_estimate_option, positive
from p4pfr_ros.cli.terminal import prepare_kernels
from p4pfr_ros.files.boards import load_boards
from p4pfr_ros.files.dependencies import how_to_get_ros, require
from p4pfr_ros.files.image_sources import is_bag
from p4pfr_ros.files.writing import check_writable
from p4pfr_ros.files.yaml_fields import ConfigError

_EPILOG = """\
SOURCE is a camera by its index (0, 1, ...), a video, a bag, or a folder of
images. --topic takes the images of a ROS topic instead; of a bag with several
image topics it selects one.

The page shows the image, how well the camera is known, and where to hold the
board next. It is served on this machine only; --host 0.0.0.0 serves it to
others, who need the token in the printed address. The command runs until
Ctrl-C, after the end of the source as well.
"""
DEFAULT_PORT = 8484
_LONGEST_WAIT_S = 0.5


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command to the parser."""
    parser = commands.add_parser(
        'live',
        help='calibrate a camera while you watch, in a web page',
        description='Calibrate a camera while you watch, in a web page.',
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.set_defaults(run=run, usage_error=parser.error)
    add = parser.add_argument
    add('source', nargs='?', metavar='SOURCE', help='camera index, video, bag, or folder')
    add('--topic', help='ROS topic of images, raw or compressed (requires ROS 2)')
    add(
        '--board',
        required=True,
        metavar='FILE',
        help='board file (YAML), of one or several boards',
    )
    add(
        '-o',
        '--output',
        type=Path,
        default=Path('camera.yaml'),
        metavar='FILE',
        help='where the page saves the camera (default: %(default)s)',
    )
    add('--name', default='camera', help='camera_name in the output (default: %(default)s)')
    add('--rate', type=positive, metavar='HZ', help='images per second of a video or a folder')
    add('--host', default='127.0.0.1', help='address to serve the page on (default: %(default)s)')
    add('--port', type=_port, default=DEFAULT_PORT, help='0: a free one (default: %(default)s)')
    add('--token', default='', help='token of the page (default: drawn, if others can reach it)')
    add_estimate_option(parser, '--threshold', 'threshold_px', 'PX')


def _port(text: str) -> int:
    port = int(text)
    if not 0 <= port <= 65535:
        raise ValueError
    return port


def run(arguments: argparse.Namespace) -> int:
    """Serve the page until SIGINT or SIGTERM."""
    source, topic = arguments.source, arguments.topic
    if (source is None and topic is None) or (source and topic and not is_bag(Path(source))):
        arguments.usage_error('expected either SOURCE or --topic')
    require('aiohttp')
    check_writable(arguments.output)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    if source is None:
        return _run_node(arguments)
    from p4pfr_ros.live.server import LiveServer  # imports aiohttp
    from p4pfr_ros.live.session import LiveSession
    from p4pfr_ros.live.sources import feed

    session = LiveSession(
        load_boards(arguments.board),
        arguments.output,
        arguments.name,
        robust=EstimateOptions(threshold_px=arguments.threshold),
    )
    prepare_kernels()
    server = LiveServer(session, arguments.host, arguments.port, arguments.token)
    try:
        server.start()
        print(f'open {server.url} (Ctrl-C ends)', flush=True)
        feed(session, source, arguments.rate, topic)
        snapshot = session.snapshot
        end = snapshot.source_detail or 'end of the images'
        print(f'{snapshot.source_name}: {end}; the page stays', flush=True)
        while True:  # a signal just before an endless wait would be noticed after it
            time.sleep(_LONGEST_WAIT_S)
    except KeyboardInterrupt:
        pass
    finally:
        server.stop()
    if not session.is_saved:
        what = 'was not saved' if session.saved is None else 'has changed since it was saved'
        print(f'p4pfr: the camera {what}', file=sys.stderr)
    return 0


def _run_node(arguments: argparse.Namespace) -> int:
    """Run dashboard_node on a topic."""
    try:
        from p4pfr_ros.ros.dashboard_node import main
    except ModuleNotFoundError as error:
        if str(error.name).startswith('p4pfr_ros'):
            raise
        raise ConfigError(
            f'--topic requires ROS 2 ({error.name} is missing): {how_to_get_ros()}'
        ) from None
    is_compressed = arguments.topic.endswith('/compressed')
    parameters: dict[str, Any] = {
        'board_file': arguments.board,
        'calibration_file': str(arguments.output),
        'camera_name': arguments.name,
        'host': arguments.host,
        'port': arguments.port,
        'token': arguments.token,
        'robust.threshold_px': arguments.threshold,
        'image.transport': 'compressed' if is_compressed else 'raw',
    }
    name = 'image/compressed' if is_compressed else 'image'
    main(['--ros-args', '-r', f'{name}:={arguments.topic}'], parameters)
    return 0
